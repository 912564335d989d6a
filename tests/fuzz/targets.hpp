#pragma once
// The laws that any bytes whatever must obey. A broken one aborts. libFuzzer feeds them at random, corpus_test.cpp
// feeds them the committed corpus.

#include <string_view>

namespace tacho::fuzz {

/// Frames: every chunking gives the same frames; what was decoded encodes to the same bytes.
void frame(std::string_view bytes);
/// 11100 / 11013 bodies: decoding is repeatable, and a field alone decodes as it does among all.
void status_json(std::string_view bytes);
/// Register images: the first byte chooses the word order, the rest is the image.
void registers(std::string_view bytes);
/// Column blocks: the first byte chooses source and word order, lines are answers, which come back byte for byte, also
/// as values; overwritten with the same bytes, or the bytes themselves taken for a block, it is refused or gives
/// nothing wrong.
void block(std::string_view bytes);

/// Modbus TCP: the first eight bytes make a request, the rest is what comes back. A verdict stands whatever follows,
/// and only what fits the request in every field is data.
void mbap(std::string_view bytes);
/// What a server refuses: two bits per address and kind of request. However it behaves, a sweep ends within its budget,
/// no value is split, and what is documented is asked for, unknown or illegal.
void register_plan(std::string_view bytes);
/// A configuration file: it is refused with file and line or with what is missing, or it is taken, and then what it is
/// written as reads the same.
void config(std::string_view bytes);
/// learned.json: whatever is in it, robots are asked for what is documented, and what is learned then is kept.
void learned(std::string_view bytes);

}  // namespace tacho::fuzz
