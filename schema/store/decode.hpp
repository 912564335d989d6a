#pragma once
// Decoders that a reader is handed, so that store and wire do not know each other (schema/log.hpp ties them together).

#include <functional>
#include <string>

#include "schema/row_source.hpp"

namespace tacho::store {

class BlockDecoder;

/// Decodes `answer` into `out` (meta is copied by the caller). `stream` gives the word order.
using Decode =
    std::function<void(const Answer& answer, const Stream& stream, const FieldSet& wanted, Gates& gates, Sample& out)>;

/// Fills the columns of `out`, its alarms and points, for all rows of an open block, as if each answer had been decoded
/// with every gate open. `out` comes with one column per wanted field, whose vectors hold anything; its times are none
/// of this. False: these answers have to be decoded one by one, and `out` is not usable. `damage`: what is wrong with a
/// column that was needed; `out` is not usable then either.
using DecodeBlock = std::function<bool(BlockDecoder& block, const Stream& stream, Batch& out, std::string& damage)>;

struct Decoders {
  Decode row;
  DecodeBlock block;  ///< empty: every answer is decoded by itself
};

}  // namespace tacho::store
