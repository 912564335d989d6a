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
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "recorder/poller.hpp"
#include "recorder/queue.hpp"
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
    std::vector<std::string> robot_names;  ///< by RobotId - 1 of this recording, see name_of
    std::vector<RobotId> robot_ids;
    std::vector<bool> expects_io;  ///< io is off, so DI and DO must come with the status answers
  };

  /// `writer` has begun its session and knows its robots; it belongs to the thread until finish() returns.
  LogThread(store::LogWriter& writer, Ingest& ingest, Options options);
  ~LogThread() override;
  /// Begins writing; `planned` may be called from now on.
  void start();

  // Sink, from any thread.
  [[nodiscard]] bool answer(Answer answer, const std::optional<Gap>& before) override;
  void gap(const Gap& gap) override;
  void event(const Event& event) override;
  void word_order(RobotId robot, Source source, WordOrder order) override;

  /// Drains the queue, ends the session, joins. Throws when the end of the session cannot be written.
  void finish(bool clean);
  [[nodiscard]] bool failed() const { return failed_; }
  [[nodiscard]] std::size_t queued() const { return queue_.size(); }
  [[nodiscard]] store::LogWriter::Stats stats() const;

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
  using Item = std::variant<Stored, Gap, Event, OrderFound>;

  void run();
  template <class Work>
  void attempt(Work work);
  void write(const Item& item);
  void commit();
  void look_for_io(const Answer& answer);
  void tell(const Event& event) const;
  [[nodiscard]] std::size_t index_of(RobotId robot) const;

  store::LogWriter& writer_;
  Ingest& ingest_;
  Options options_;
  Queue<Item> queue_;
  std::vector<int> answers_without_io_;
  std::exception_ptr error_;  // written by the thread, read after join
  bool clean_ = false;        // written before the queue is closed, read after
  bool disk_fails_ = false;   // told, and nothing was committed since
  std::atomic<bool> failed_{false};
  mutable std::mutex stats_mutex_;
  store::LogWriter::Stats stats_;
  std::thread thread_;
};

}  // namespace tacho::recorder
