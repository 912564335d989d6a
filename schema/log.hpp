#pragma once
// Ties wire and store together: the way into a log for recorder and simulator, the way out for the analyzer.

#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "schema/row_source.hpp"
#include "schema/store/log_writer.hpp"

namespace tacho {

/// Opens a log for reading. Throws Error as LogReader does.
std::unique_ptr<RowSource> open_log(std::span<const std::filesystem::path> logs);

/// Decodes one stored answer of any source.
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

/// Answers in, rows and events out: decodes each answer once, derives events, notes coverage, identity and robot clock.
/// One thread, the writer's.
class Ingest {
 public:
  explicit Ingest(store::LogWriter& writer);
  ~Ingest();
  Ingest(const Ingest&) = delete;
  Ingest& operator=(const Ingest&) = delete;

  /// Must be called after LogWriter::begin_session and before the first answer of a stream.
  void declare(const Stream& stream);
  void append(const Answer& answer);
  void add(const Gap& gap);
  void add(const Event& event);
  void set_word_order(RobotId robot, Source source, WordOrder order);
  /// The last decoded sample of append(), for status lines. Valid until the next append().
  [[nodiscard]] const Sample& last() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho
