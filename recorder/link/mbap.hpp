#pragma once
// Modbus TCP frames as bytes: the two requests that exist, and the judgement of what comes back. Pure, no I/O.
//   0-1 transaction | 2-3 protocol, 0 | 4-5 length of what follows | 6 unit | 7 function | data
//
// Ours instead of libmodbus', which neither compares the unit and the length of the header with the answer nor waits
// for a descriptor above 1023 (select). What is judged here: transaction, protocol, length, unit, function, byte count.

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "schema/wire/registers.hpp"

namespace tacho::recorder::mbap {

inline constexpr std::size_t kHeaderBytes = 7;
inline constexpr std::size_t kMaxFrameBytes = 260;
inline constexpr std::uint16_t kMaxRegisters = 125;  ///< of one request, by the protocol
inline constexpr std::uint16_t kMaxInputs = 16 * kMaxRegisters;

/// There are no others: this recorder only reads.
enum class Function : std::uint8_t { discrete_inputs = 2, input_registers = 4 };

struct Request {
  std::uint16_t transaction = 0;
  std::uint8_t unit = 1;
  Function function = Function::input_registers;
  std::uint16_t address = 0;  ///< as sent, from 0
  std::uint16_t count = 1;    ///< 1 to kMaxRegisters or kMaxInputs
};

/// A whole frame, ready to send.
std::string encode(const Request& request);

enum class Verdict : std::uint8_t {
  incomplete,     ///< nothing wrong so far, more bytes are needed
  data,           ///< the values asked for
  exception,      ///< refused, see `exception`
  other_request,  ///< well-formed, but of another transaction: out of step, close the connection
  malformed,      ///< not an answer to this request, see `why`; close the connection
};

struct Answer {
  Verdict verdict = Verdict::incomplete;
  std::string_view payload;    ///< of `data`: the bytes behind the byte count, a part of what was judged
  std::uint8_t exception = 0;  ///< code, 0 when there is none
  std::size_t size = 0;        ///< bytes of a whole frame; what follows them was not asked for
  std::string why;             ///< of `other_request` and `malformed`, one clause
};

/// Judges all bytes received since `request` was sent. A wrong header is told before the rest has arrived.
Answer judge(std::string_view bytes, const Request& request);

}  // namespace tacho::recorder::mbap
