#pragma once
// The flags that conditions of registers name ([3x]44 is only meaningful while [1x]2), as far as the inputs still vouch
// for them: what was read before a gap of the inputs, or in another session, says nothing about the time after.

#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "schema/row_source.hpp"

namespace tacho::store {

class InputGates {
 public:
  /// `registers`: the fields asked for.
  explicit InputGates(const FieldSet& registers);
  /// Some field has a condition.
  [[nodiscard]] bool needed() const { return needed_; }
  /// What inputs have to be read for it, asked for or not.
  [[nodiscard]] const FieldSet& flags() const { return flags_; }

  void begin_part(std::span<const Gap> gaps);
  /// Remembers rows [begin, end) of inputs, which have all flags. `place`: of every row of the batch.
  void inputs(SessionId session, const Batch& batch, std::span<const std::int64_t> place, std::size_t begin,
              std::size_t end);
  /// Marks values of registers whose condition does not hold. All earlier rows of inputs must be known. `place`: of the
  /// rows of the batch, after those of earlier calls.
  void apply(SessionId session, std::span<const std::int64_t> place, Batch& registers);
  /// Takes in all rows of inputs.
  void catch_up();

 private:
  /// Bit i: flag_list_[i].
  struct Row {
    SessionId session = 0;
    std::uint64_t seq = 0;
    Micros t_send_us = 0;
    std::int64_t place = 0;
    std::uint64_t known = 0;
    std::uint64_t on = 0;
  };
  using Poll = std::pair<SessionId, std::uint64_t>;
  FieldSet flags_;
  bool needed_ = false;
  std::vector<FieldIndex> flag_list_;
  std::vector<Row> rows_;  ///< of inputs, not yet taken in
  std::size_t next_ = 0;   ///< of rows_
  std::uint64_t known_ = 0;
  std::uint64_t on_ = 0;
  Poll last_{};                  ///< the newest answer of inputs
  std::map<Poll, Micros> gaps_;  ///< first missed poll -> since when

  void expire(SessionId session, Micros t_send_us);
  void take(const Row& row);
};

}  // namespace tacho::store
