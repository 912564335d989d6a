#pragma once
// The writer's end of the queue: one thread that owns LogWriter and Ingest, commits at a fixed interval, and ends the
// session. SQLite is touched nowhere else while it runs.
//
// A disk that fails or is full does not end a recording: it is told once, what could not be written becomes gap rows of
// cause disk as soon as writing works again (LogWriter does that), and that is told too.

#include <atomic>
#include <chrono>
#include <cstdint>
#include <exception>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "recorder/config.hpp"
#include "recorder/poller.hpp"
#include "recorder/queue.hpp"
#include "recorder/ring.hpp"
#include "recorder/robot_clock.hpp"
#include "recorder/snapshot.hpp"
#include "schema/log.hpp"

namespace tacho::recorder {

class LogThread final : public Sink {
 public:
  struct Options {
    std::chrono::microseconds commit_interval{1'000'000};
    std::size_t queue_items = 20'000;
    std::size_t queue_bytes = 64u << 20;
    /// Hands the planned counts of all streams to the writer; called before each commit.
    std::function<void(store::LogWriter&)> planned;
    std::function<void(const std::string&)> notice;
    store::Forecast forecast;  ///< as of the start
    RingSettings ring;
  };

  /// `writer` has begun its session; it belongs to the thread until finish() returns.
  LogThread(store::LogWriter& writer, Ingest& ingest, Options options);
  ~LogThread() override;
  /// What is recorded of a robot from now on; `name`: in messages. Before start(), or inside call().
  void watch(RobotId robot, const std::string& name, const RobotConfig& config);
  /// Begins writing; `planned` may be called from now on.
  void start();
  /// Runs `task` on the thread, after everything queued so far, and waits for it. Throws what it throws, or Error when
  /// the thread has ended.
  void call(std::function<void()> task);

  // Sink, from any thread.
  [[nodiscard]] bool answer(Answer answer, const std::optional<Gap>& before) override;
  void gap(const Gap& gap) override;
  void event(const Event& event) override;
  void word_order(RobotId robot, Source source, WordOrder order) override;

  /// Drains the queue, ends the session, joins. Throws when the end of the session cannot be written.
  void finish(bool clean);
  [[nodiscard]] bool failed() const { return failed_; }
  /// How long it has been at one row or one commit; 0 while it waits for work.
  [[nodiscard]] Micros busy_us() const;

  struct StreamNumbers {
    store::LogWriter::Tally tally;  ///< as committed
    Histogram round_trip;
    Micros last_round_trip_us = 0;
    Micros last_answer_us = 0;
    std::uint64_t aged_out = 0;  ///< polls of the ring that nothing happened after
  };
  struct ClockOffset {
    Micros offset_us = 0;
    Micros told_us = 0;  ///< monotonic
  };
  struct Numbers {
    std::size_t ring_bytes = 0;
    std::size_t queue_items = 0;
    std::size_t queue_bytes = 0;
    store::LogWriter::Stats writer;  ///< as committed
    Histogram commits;
    std::map<std::pair<RobotId, Source>, StreamNumbers> streams;
    std::map<RobotId, ClockOffset> clock_offsets;  ///< told in the last minutes
    store::Forecast forecast;
  };
  [[nodiscard]] Numbers numbers() const;

 private:
  struct OrderFound {
    RobotId robot;
    Source source;
    WordOrder order;
  };
  struct Stored {
    Answer answer;
    std::optional<Gap> before;
  };
  using Task = std::function<void()>;
  using Item = std::variant<Stored, Gap, Event, OrderFound, Task>;
  struct Watched {
    std::string name;
    bool expects_io = false;  // io is off, so DI and DO must come with the status answers
    int answers_without_io = 0;
  };

  void run();
  template <class Work>
  void attempt(Work work);
  void write(Item& item);
  void write_row(const Item& item);
  void write_ring(const Ring::Row& row);
  void look_at(const Event& event);
  bool keep(Item& item);
  void plan();
  void commit();
  void measure(const AnswerMeta& meta);
  void learn_clock(RobotId robot);
  void publish();
  void foretell();
  void look_for_io(const Answer& answer);
  void tell(Event event);

  store::LogWriter& writer_;
  Ingest& ingest_;
  Options options_;
  Queue<Item> queue_;
  Ring ring_;
  std::vector<std::pair<Event, std::string>> triggered_;  // by the row that is being written
  std::map<RobotId, Watched> watched_;
  std::map<RobotId, RobotClock> clocks_;
  std::exception_ptr error_;  // written by the thread, read after join
  bool clean_ = false;        // written before the queue is closed, read after
  bool disk_fails_ = false;   // told, and nothing was committed since
  std::atomic<bool> failed_{false};
  std::atomic<bool> ended_{false};
  std::atomic<Micros> busy_since_us_{0};  // monotonic; 0: waiting
  std::chrono::steady_clock::time_point foretell_at_;
  mutable std::mutex numbers_mutex_;
  Numbers numbers_;
  std::thread thread_;
};

}  // namespace tacho::recorder
