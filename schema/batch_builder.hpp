#pragma once
// Appends decoded samples, or rows of other batches, to the columns of a Batch.

#include "schema/row_source.hpp"

namespace tacho {

class BatchBuilder {
 public:
  BatchBuilder(Source source, const FieldSet& fields);
  void append(const Sample& sample);
  /// Rows [begin, end) of a batch that has all columns of this one.
  void append(const Batch& from, std::size_t begin, std::size_t end);
  [[nodiscard]] std::size_t rows() const { return batch_.rows(); }
  /// The batch so far; the builder starts an empty one with the same columns.
  Batch take();
  /// The memory of a batch that take() gave serves the next one. Only while this one is empty.
  void reuse(Batch&& batch);
  /// A batch with the same columns for somebody who fills all of them at once. `used`: an earlier one of the same
  /// columns, or an empty one; its times and columns stay as they are, because emptying them takes time. Lists and
  /// texts are empty.
  Batch blank(Batch&& used) const;

 private:
  Batch batch_;
  FieldSet fields_;
  bool alarms_ = false;
  bool points_ = false;
  void start(Batch& batch) const;
  void clear_lists(Batch& batch) const;
  template <class MoveText>
  void append_lists(std::span<const AlarmItem> alarms, LevelSet incomplete, std::span<const IoPoint> points,
                    MoveText move_text);
};

}  // namespace tacho
