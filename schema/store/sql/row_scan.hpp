#pragma once
// Rows of one source, pulled one by one. A RowSource pushes: it is asked for one stretch of time after the other, each
// kept in memory until its last row was taken. The first stretch is short, so that the first rows come at once; the
// following ones grow until they hold about 16 MB.
//
// Rows come by robot; those of one robot by time, but for clocks that were set back between two stretches.
// Thread rule: that of the RowSource, which must outlive the scan and may serve others between two calls.

#include <array>
#include <optional>
#include <vector>

#include "schema/row_source.hpp"

namespace tacho::store::sql {

class RowScan {
 public:
  struct Query {
    Source source = Source::status;
    std::vector<Robot> robots;
    Window window;    ///< of t_send_us
    FieldSet fields;  ///< read from the start; others are read when column() asks for them
  };
  RowScan(RowSource& log, Query query);

  /// To the next row; false at the end. Before the first call there is no row.
  bool next();
  [[nodiscard]] const Robot& robot() const { return query_.robots[robot_]; }
  [[nodiscard]] SessionId session() const { return piece().session; }
  [[nodiscard]] const Batch& batch() const { return piece().batch; }
  /// Index of the row in batch().
  [[nodiscard]] std::size_t row() const { return row_; }

  /// The field's column of batch(). One that was not asked for yet is read now, by reading the stretch again, and from
  /// then on with all others; null when the log does not give it.
  const Column* column(FieldIndex field);
  /// The same for many fields.
  void need(const FieldSet& fields);

 private:
  struct Piece {
    SessionId session = 0;
    Batch batch;
  };
  RowSource* log_;
  Query query_;
  std::size_t robot_ = 0;
  Window stretch_;               ///< in memory now
  std::optional<Micros> until_;  ///< end of the robot's rows; empty before its first stretch
  Micros length_ = 0;            ///< of the next stretch
  Micros period_us_ = 1'000'000;
  std::vector<Piece> pieces_;
  std::size_t piece_ = 0;
  std::size_t row_ = 0;
  bool started_ = false;                              ///< row_ is a row of piece_, not yet to be counted up
  std::array<const Column*, kFieldCount> columns_{};  ///< of the piece

  [[nodiscard]] const Piece& piece() const { return pieces_[piece_]; }
  [[nodiscard]] Micros longest() const;
  bool next_in_memory();
  bool next_stretch();
  bool begin_robot();
  void load();
  void enter_piece();
};

}  // namespace tacho::store::sql
