#pragma once
// Batches -> rows of the odometry analysis, and the fields it asks for.

#include <vector>

#include "analyzer/analyses/odometry_segments.hpp"

namespace tacho::odometry {

/// RawRow and what only the JSON <-> Modbus comparison needs.
struct CrossRow {
  RawRow base;
  double soc = kNone;  ///< 0..1
  double total_time_s = kNone;
  int task = -1;
  int block_reason = -1;
  int station = -1;                 ///< -1 = not given, 0 = at none; JSON: the number in "LM12"
  bool codes_given = false;         ///< JSON: alarm arrays present; registers: first codes present
  std::vector<std::int64_t> codes;  ///< JSON: all codes; registers: first fatal, error, warning, without 0
};

std::vector<Need> row_needs();

/// Calls visit for every row of `source` in the slice.
class RowReader {
 public:
  RowReader(const Slice& slice, Source source);
  [[nodiscard]] std::size_t rows() const { return batch_ == nullptr ? 0 : batch_->rows(); }
  [[nodiscard]] CrossRow at(std::size_t row) const;

 private:
  const Batch* batch_;
  SessionId session_;
  bool registers_;
  std::array<const Column*, kFieldCount> columns_{};

  [[nodiscard]] double real(FieldIndex f, std::size_t row) const;
  [[nodiscard]] std::int64_t integer(FieldIndex f, std::size_t row, std::int64_t missing) const;
  [[nodiscard]] std::uint64_t map_hash(std::size_t row) const;
  void add_codes(CrossRow& out, std::size_t row) const;
};

}  // namespace tacho::odometry
