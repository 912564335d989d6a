#include "samples/simulator/link_faults.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "schema/error.hpp"
#include "schema/text.hpp"
#include "schema/wire/frame.hpp"

namespace tacho::sim {
namespace {

using namespace std::chrono_literals;
using Kind = Action::Kind;
using Stage = LinkFault::When;

constexpr auto kLate = 400ms;       // longer than the timeout of a test, shorter than a person's patience
constexpr auto kDripEvery = 20ms;   // a Modbus answer takes 4 s, a status answer minutes
constexpr auto kSoon = 3ms;         // a packet of its own
constexpr auto kUntilRead = 100ms;  // a close with unread bytes resets and may take the last words with it
constexpr int kFewAnswers = 3;
constexpr std::size_t kFunctionAt = 7;  // of a Modbus frame

Action send(std::string bytes, std::chrono::microseconds after = {}) { return {Kind::send, std::move(bytes), after}; }
Action end(Kind kind, std::chrono::microseconds after = {}) { return {kind, {}, after}; }

Script silence(const Exchange&) { return {}; }
Script close(const Exchange&) { return {end(Kind::close)}; }
Script reset(const Exchange&) { return {end(Kind::reset)}; }
Script half_close(const Exchange&) { return {end(Kind::half_close)}; }
Script answer_then_close(const Exchange& x) { return {send(x.answer), end(Kind::close)}; }
Script answer_then_half_close(const Exchange& x) { return {send(x.answer), end(Kind::half_close)}; }
Script close_after_few(const Exchange& x) {
  return x.nth < kFewAnswers ? Script{send(x.answer)} : Script{end(Kind::close)};
}
Script slow(const Exchange& x) { return {send(x.answer, 20ms)}; }
Script late(const Exchange& x) { return {send(x.answer, kLate)}; }
Script duplicate(const Exchange& x) { return {send(x.answer + x.answer)}; }
Script duplicate_soon(const Exchange& x) { return {send(x.answer), send(x.answer, kSoon)}; }
Script duplicate_late(const Exchange& x) { return {send(x.answer), send(x.answer, kLate)}; }
Script previous_first(const Exchange& x) { return {send(x.previous + x.answer)}; }
Script previous_instead(const Exchange& x) { return {send(x.previous.empty() ? x.answer : x.previous)}; }
Script one_behind(const Exchange& x) { return x.previous.empty() ? Script{} : Script{send(x.previous)}; }
Script cut_header(const Exchange& x) { return {send(x.answer.substr(0, 5))}; }
Script cut_body(const Exchange& x) { return {send(x.answer.substr(0, x.answer.size() * 2 / 3))}; }
Script cut_body_close(const Exchange& x) {
  return {send(x.answer.substr(0, x.answer.size() * 2 / 3)), end(Kind::close, kUntilRead)};
}
Script cut_last_byte(const Exchange& x) { return {send(x.answer.substr(0, x.answer.size() - 1))}; }
Script two_pieces(const Exchange& x) { return {send(x.answer.substr(0, 6)), send(x.answer.substr(6), kSoon)}; }

Script bytes(const Exchange& x, std::chrono::microseconds every) {
  Script out;
  for (const char byte : x.answer) {
    out.push_back(send(std::string(1, byte), every));
  }
  return out;
}
Script byte_at_a_time(const Exchange& x) { return bytes(x, 0us); }
Script slow_drip(const Exchange& x) { return bytes(x, kDripEvery); }

Script garbage_before(const Exchange& x) { return {send("\x13\x37" + x.answer)}; }
Script garbage_behind(const Exchange& x) { return {send(x.answer + "\x13\x37")}; }
Script http(const Exchange&) { return {send("HTTP/1.1 400 Bad Request\r\nConnection: close\r\n\r\n")}; }
Script zeros(const Exchange& x) { return {send(std::string(x.answer.size(), '\0'))}; }
Script random_bytes(const Exchange& x) {
  std::string out = x.answer;
  unsigned state = 12345u + static_cast<unsigned>(x.nth);
  for (char& byte : out) {
    state = state * 1103515245u + 12345u;
    byte = static_cast<char>(state >> 16 & 0xFF);
  }
  return {send(out)};
}

/// The answer with `value` added to the byte at `at`.
template <std::size_t at, int value>
Script edited(const Exchange& x) {
  std::string out = x.answer;
  out[at] = static_cast<char>(out[at] + value);
  return {send(out)};
}

// Status port: a frame like the answer's, with another type or body.

std::string reframed(const Exchange& x, std::string_view body, std::uint16_t type = 0,
                     std::array<std::uint8_t, 6> reserved = {4, 0x4C}) {
  const auto byte = [&](std::size_t at) { return static_cast<unsigned>(static_cast<unsigned char>(x.answer[at])); };
  const unsigned own = byte(8) << 8 | byte(9);
  return wire::encode_frame(static_cast<std::uint8_t>(byte(1)), static_cast<std::uint16_t>(byte(2) << 8 | byte(3)),
                            type == 0 ? static_cast<std::uint16_t>(own) : type, body, reserved);
}
std::string_view body_of(const Exchange& x) { return std::string_view(x.answer).substr(wire::kHeaderBytes); }

template <std::uint16_t type>
Script error_frame(const Exchange& x) {
  return {send(reframed(x, "", type))};
}
Script empty_body(const Exchange& x) { return {send(reframed(x, ""))}; }
Script no_json(const Exchange& x) { return {send(reframed(x, "robokit is starting"))}; }
Script cut_json(const Exchange& x) { return {send(reframed(x, body_of(x).substr(0, body_of(x).size() / 2)))}; }
Script bad_utf8(const Exchange& x) { return {send(reframed(x, "{\"vehicle_id\":\"\xFF\xFE\xC0\",\"x\":1}"))}; }
Script compressed(const Exchange& x) {
  return {send(reframed(x, "\x1F\x8B\x08\x01 not unpacked by anybody", 0, {4, 0x4C, 0, 0, 1, 0}))};
}
Script reserved_bytes(const Exchange& x) { return {send(reframed(x, body_of(x), 0, {0xDE, 0xAD, 0xBE, 0xEF, 0, 2}))}; }
Script huge_length(const Exchange& x) {
  std::string out = x.answer;
  out[4] = '\x7F';
  return {send(out)};
}
Script long_length(const Exchange& x) {
  std::string out = x.answer;
  out[5] = static_cast<char>(out[5] + 1);  // 64 KiB more than there is
  return {send(out)};
}
Script unasked(const Exchange& x) { return {send(wire::encode_frame(1, 0, 19301, "{\"x\":1}") + x.answer)}; }
Script client_limit(const Exchange&) {
  return {
      send(wire::encode_frame(1, 0, 19204, R"({"ret_code":61001,"err_msg":"connection limit reached","port":19204})")),
      end(Kind::close, kUntilRead)};
}

// Modbus.

template <char code>
Script exception(const Exchange& x) {
  std::string out = x.answer.substr(0, 4) + std::string("\0\x03", 2) + x.answer.substr(6, 2) + code;
  out[kFunctionAt] = static_cast<char>(static_cast<unsigned char>(out[kFunctionAt]) | 0x80);
  return {send(out)};
}

// clang-format off
const std::array kFaults{
    LinkFault{"refuse", "nobody listens, connections are dropped", Stage::listening, false, silence, silence},
    LinkFault{"silent_accept", "connected, never heard", Stage::connecting, false, silence, silence},
    LinkFault{"close_on_accept", "closed as soon as connected", Stage::connecting, false, close, close},
    LinkFault{"reset_on_accept", "reset as soon as connected", Stage::connecting, false, reset, reset},
    LinkFault{"client_limit", "61001, too many clients", Stage::connecting, false, client_limit, nullptr},
    LinkFault{"silence", "no answer", Stage::answering, false, silence, silence},
    LinkFault{"close", "closed instead of an answer", Stage::answering, false, close, close},
    LinkFault{"reset", "reset instead of an answer", Stage::answering, false, reset, reset},
    LinkFault{"half_close", "end of file, but still connected", Stage::answering, false, half_close, half_close},
    LinkFault{"answer_then_close", "one answer per connection", Stage::answering, true, answer_then_close, answer_then_close},
    LinkFault{"answer_then_half_close", "an answer, then end of file", Stage::answering, true, answer_then_half_close, answer_then_half_close},
    LinkFault{"close_after_few", "closed after three answers", Stage::answering, false, close_after_few, close_after_few},
    LinkFault{"slow", "20 ms late", Stage::answering, true, slow, slow},
    LinkFault{"late", "400 ms late", Stage::answering, false, late, late},
    LinkFault{"duplicate", "every answer twice in one packet", Stage::answering, true, duplicate, duplicate},
    LinkFault{"duplicate_soon", "every answer again 3 ms later", Stage::answering, false, duplicate_soon, duplicate_soon},
    LinkFault{"duplicate_late", "every answer again 400 ms later", Stage::answering, false, duplicate_late, duplicate_late},
    LinkFault{"previous_first", "the answer before, then the right one", Stage::answering, false, previous_first, previous_first},
    LinkFault{"previous_instead", "the answer before instead", Stage::answering, false, previous_instead, previous_instead},
    LinkFault{"one_behind", "every answer comes after the next request", Stage::answering, false, one_behind, one_behind},
    LinkFault{"cut_header", "five bytes, then silence", Stage::answering, false, cut_header, cut_header},
    LinkFault{"cut_body", "two thirds, then silence", Stage::answering, false, cut_body, cut_body},
    LinkFault{"cut_body_close", "two thirds, then closed", Stage::answering, false, cut_body_close, cut_body_close},
    LinkFault{"cut_last_byte", "the last byte is missing", Stage::answering, false, cut_last_byte, cut_last_byte},
    LinkFault{"two_pieces", "the header is split over two packets", Stage::answering, true, two_pieces, two_pieces},
    LinkFault{"byte_at_a_time", "one packet per byte", Stage::answering, true, byte_at_a_time, byte_at_a_time},
    LinkFault{"slow_drip", "one byte every 20 ms", Stage::answering, false, slow_drip, slow_drip},
    LinkFault{"garbage_before", "two bytes before the answer", Stage::answering, false, garbage_before, garbage_before},
    LinkFault{"garbage_behind", "two bytes behind the answer", Stage::answering, true, garbage_behind, garbage_behind},
    LinkFault{"http", "another service on the port", Stage::answering, false, http, http},
    LinkFault{"zeros", "as many zeros as bytes", Stage::answering, false, zeros, zeros},
    LinkFault{"random_bytes", "as many random bytes", Stage::answering, false, random_bytes, random_bytes},
    LinkFault{"huge_length", "a length of 2 GiB, or of 32 KiB on Modbus", Stage::answering, false, huge_length, edited<4, 0x7F>},
    LinkFault{"long_length", "a length larger than the answer", Stage::answering, false, long_length, edited<5, 1>},
    LinkFault{"short_length", "a length smaller than the answer", Stage::answering, false, nullptr, edited<5, -1>},
    LinkFault{"wrong_sequence", "another sequence or transaction number", Stage::answering, false, edited<3, 77>, edited<1, 77>},
    LinkFault{"wrong_type", "the type of another answer, or another function", Stage::answering, false, edited<9, 1>, edited<7, -1>},
    LinkFault{"wrong_start", "another first byte, or another protocol number", Stage::answering, false, edited<0, 1>, edited<3, 1>},
    LinkFault{"wrong_unit", "another unit answers", Stage::answering, false, nullptr, edited<6, 8>},
    LinkFault{"wrong_byte_count", "a byte count that is not the one asked for", Stage::answering, false, nullptr, edited<8, 2>},
    LinkFault{"exception_1", "illegal function", Stage::answering, false, nullptr, exception<1>},
    LinkFault{"exception_2", "illegal data address", Stage::answering, false, nullptr, exception<2>},
    LinkFault{"exception_3", "illegal data value", Stage::answering, false, nullptr, exception<3>},
    LinkFault{"exception_4", "device failure", Stage::answering, false, nullptr, exception<4>},
    LinkFault{"exception_5", "acknowledge", Stage::answering, false, nullptr, exception<5>},
    LinkFault{"exception_6", "device busy", Stage::answering, false, nullptr, exception<6>},
    LinkFault{"exception_10", "gateway path unavailable", Stage::answering, false, nullptr, exception<10>},
    LinkFault{"exception_11", "gateway target did not respond", Stage::answering, false, nullptr, exception<11>},
    LinkFault{"error_60000", "wrong port", Stage::answering, false, error_frame<60000>, nullptr},
    LinkFault{"error_60001", "unknown request", Stage::answering, false, error_frame<60001>, nullptr},
    LinkFault{"error_60002", "bad JSON", Stage::answering, false, error_frame<60002>, nullptr},
    LinkFault{"error_60003", "wrong version", Stage::answering, false, error_frame<60003>, nullptr},
    LinkFault{"error_60004", "too large", Stage::answering, false, error_frame<60004>, nullptr},
    LinkFault{"unasked", "a pushed frame before the answer", Stage::answering, false, unasked, nullptr},
    LinkFault{"other_version", "another version byte", Stage::answering, true, edited<1, 1>, nullptr},
    LinkFault{"reserved_bytes", "other reserved bytes", Stage::answering, true, reserved_bytes, nullptr},
    LinkFault{"empty_body", "no body", Stage::answering, true, empty_body, nullptr},
    LinkFault{"no_json", "a body that is no JSON", Stage::answering, true, no_json, nullptr},
    LinkFault{"cut_json", "half a JSON text in a whole frame", Stage::answering, true, cut_json, nullptr},
    LinkFault{"bad_utf8", "a text that is no UTF-8", Stage::answering, true, bad_utf8, nullptr},
    LinkFault{"compressed", "a compressed body", Stage::answering, true, compressed, nullptr},
};
// clang-format on

std::size_t index(Port port) { return static_cast<std::size_t>(port); }

double parse_seconds(std::string_view text, const std::string& whole) {
  double value = 0;
  const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || rest != text.data() + text.size()) {
    throw Error("fault '" + whole + "'", "'" + std::string(text) + "' is no time",
                "write NAME@FROM..TO in seconds, for example silence@10..20, or modbus:silence@10..");
  }
  return value;
}

}  // namespace

std::string_view port_name(Port port) {
  return port == Port::status ? "status" : port == Port::modbus ? "modbus" : "push";
}

std::span<const LinkFault> link_faults() { return kFaults; }

const LinkFault* find_link_fault(std::string_view name) {
  const auto* const found =
      std::find_if(kFaults.begin(), kFaults.end(), [name](const LinkFault& fault) { return fault.name == name; });
  return found == kFaults.end() ? nullptr : found;
}

FaultWindow parse_fault_window(const std::string& text) {
  FaultWindow window;
  std::string_view rest = text;
  for (const Port port : kPorts) {
    const std::string prefix = std::string(port_name(port)) + ":";
    if (rest.substr(0, prefix.size()) == prefix) {
      window.port = port;
      rest.remove_prefix(prefix.size());
    }
  }
  const std::size_t at = rest.find('@');
  window.fault = rest.substr(0, at);
  if (at != std::string_view::npos) {
    const std::string_view times = rest.substr(at + 1);
    const std::size_t dots = times.find("..");
    window.from_s = parse_seconds(times.substr(0, dots), text);
    if (dots != std::string_view::npos && dots + 2 < times.size()) {
      window.to_s = parse_seconds(times.substr(dots + 2), text);
    }
  }
  check_fault_window(window, "--fault " + text);
  return window;
}

void check_fault_window(const FaultWindow& window, const std::string& where) {
  const LinkFault* const fault = find_link_fault(window.fault);
  if (fault == nullptr) {
    std::vector<std::string> known;
    for (const LinkFault& row : kFaults) {
      known.emplace_back(row.name);
    }
    throw Error(where, "unknown fault '" + window.fault + "'" + did_you_mean(window.fault, known), "");
  }
  if (window.port && fault->on(*window.port) == nullptr) {
    throw Error(where, fmt::format("there is no {} on the {} port", window.fault, port_name(*window.port)), "");
  }
  if (!(window.from_s >= 0) || !(window.to_s > window.from_s)) {
    throw Error(where, "ends before it begins", "write times in seconds since the start, the earlier one first");
  }
}

FaultPlan::FaultPlan(std::vector<FaultWindow> windows)
    : windows_(std::move(windows)), start_(std::chrono::steady_clock::now()) {}

void FaultPlan::set(Port port, const LinkFault* fault) {
  const std::lock_guard lock(mutex_);
  overridden_[index(port)] = true;
  forced_[index(port)] = fault != nullptr && fault->on(port) != nullptr ? fault : nullptr;
}

const LinkFault* FaultPlan::active(Port port) const {
  {
    const std::lock_guard lock(mutex_);
    if (overridden_[index(port)]) {
      return forced_[index(port)];
    }
  }
  const double now_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  for (const FaultWindow& window : windows_) {
    const LinkFault* const fault = find_link_fault(window.fault);
    const bool here = !window.port || *window.port == port;
    if (here && now_s >= window.from_s && now_s < window.to_s && fault != nullptr && fault->on(port) != nullptr) {
      return fault;
    }
  }
  return nullptr;
}

bool FaultPlan::listens(Port port) const {
  const LinkFault* const fault = active(port);
  return fault == nullptr || fault->when != Stage::listening;
}

std::optional<Script> FaultPlan::welcome(Port port) const {
  const LinkFault* const fault = active(port);
  return fault != nullptr && fault->when == Stage::connecting ? std::optional(fault->on(port)({})) : std::nullopt;
}

Script FaultPlan::answer(Port port, const Exchange& exchange) const {
  const LinkFault* const fault = active(port);
  if (fault == nullptr || fault->when != Stage::answering) {
    return {send(exchange.answer)};
  }
  return fault->on(port)(exchange);
}

}  // namespace tacho::sim
