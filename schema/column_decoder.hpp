#pragma once
// Whole blocks -> columns of a batch, by the rules of schema/wire (scale, "no sensor" marks, conditions, alarms,
// points) but without putting the answers together. What it gives is what AnswerDecoder gives row by row with every
// gate open.
//
// Thread rule: one thread per object. Keep one for many blocks: its memory is reused.

#include <memory>
#include <string>

#include "schema/records.hpp"
#include "schema/row_source.hpp"
#include "schema/store/block/block_decoder.hpp"

namespace tacho {

class ColumnDecoder {
 public:
  ColumnDecoder();
  ~ColumnDecoder();
  /// See store::DecodeBlock.
  bool decode(store::BlockDecoder& block, const Stream& stream, Batch& out, std::string& damage);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho
