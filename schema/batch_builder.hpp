#pragma once
// Appends decoded samples to the columns of a Batch. Used by every RowSource that decodes row by row.

#include "schema/row_source.hpp"

namespace tacho {

class BatchBuilder {
 public:
  BatchBuilder(Source source, const FieldSet& fields);
  void append(const Sample& sample);
  [[nodiscard]] std::size_t rows() const { return batch_.rows(); }
  /// The batch so far; the builder starts an empty one with the same columns.
  Batch take();

 private:
  Batch batch_;
  FieldSet fields_;
  bool alarms_ = false;
  bool points_ = false;
  void start();
};

}  // namespace tacho
