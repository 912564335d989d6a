#pragma once
// Ties wire and store together: the way into a log for recorder and simulator, the way out for the analyzer.

#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "schema/row_source.hpp"
#include "schema/store/log_writer.hpp"

namespace tacho {

/// What the store asks about bodies: LogReader, and LogWriter for its rollups. Copies share buffers: one thread.
store::Decode answer_decode();

/// Opens a log for reading. Throws Error as LogReader does.
std::unique_ptr<RowSource> open_log(std::span<const std::filesystem::path> logs);
/// The same, faster, for a program that is prepared for SIGBUS: see store::Access.
std::unique_ptr<RowSource> open_log_fast(std::span<const std::filesystem::path> logs);

/// Decodes one stored answer of any source. `gates` belongs to the caller, one per robot: answers of `inputs` set it,
/// answers of `registers` need it. It must be emptied where a session begins and where `inputs` has a gap, because a
/// flag that nobody reads any more says nothing.
class AnswerDecoder {
 public:
  AnswerDecoder();
  ~AnswerDecoder();
  void decode(const Answer& answer, WordOrder order, const FieldSet& wanted, bool collect_unknown, Gates& gates,
              Sample& out);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Host wall clock minus host monotonic clock: constant but for steps and slewing of the wall clock.
Micros host_wall_minus_mono();

/// Answers in, rows and events out: decodes each answer once, derives events, notes coverage, identity and robot clock.
/// One thread, the writer's.
///
/// Clock points are made per robot: one a minute, at the middle of an answer that carries the robot's clock
/// (create_on); robots that never send it get points of the host clocks alone, after 70 s. When the wall clock has
/// stepped by more than 0.5 s against the monotonic one since the robot's last point, a point and a clock_step event
/// follow at once.
class Ingest {
 public:
  /// `wall_minus_mono` is asked once per answer. A log that is made, not recorded, passes a constant.
  explicit Ingest(store::LogWriter& writer, std::function<Micros()> wall_minus_mono = host_wall_minus_mono);
  ~Ingest();
  Ingest(const Ingest&) = delete;
  Ingest& operator=(const Ingest&) = delete;

  /// Must be called after LogWriter::begin_session and before the first answer of a stream.
  void declare(const Stream& stream);
  void append(const Answer& answer);
  void add(const Gap& gap);
  void add(const Event& event);
  void set_word_order(RobotId robot, Source source, WordOrder order);
  /// Called from append() with every event it derives; must not append.
  void on_event(std::function<void(const Event&)> call);
  /// The last decoded sample of append(), for status lines. Valid until the next append().
  [[nodiscard]] const Sample& last() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho
