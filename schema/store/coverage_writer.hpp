#pragma once
// When the writer puts the counts of the open session's streams on record. Counts follow from hot rows, so all of them
// are written only now and then; what does not (fields seen for the first time, answers that could not be decoded) goes
// into the next commit, as news of that one stream beside the counts that were written last.

#include <cstdint>
#include <map>

#include "schema/store/part_writer.hpp"
#include "schema/store/stream_state.hpp"

namespace tacho::store {

class CoverageWriter {
 public:
  /// All counts belong into the next commit.
  void demand() { demanded_ = true; }
  [[nodiscard]] bool due() const { return demanded_ || commits_ + 1 >= kCommits; }

  /// Inside the open transaction. `place`: of the newest answer that is counted. Throw SqliteError.
  static void put_all(PartWriter& part, const WriterHead& head, std::int64_t place);
  static void put_news(PartWriter& part, const WriterHead& head);

  /// The transaction is committed; `all`: with put_all().
  void committed(WriterHead& head, bool all);

 private:
  static constexpr std::uint64_t kCommits = 300;

  bool demanded_ = false;
  std::uint64_t commits_ = 0;  // since all were written
};

}  // namespace tacho::store
