#pragma once
// Robokit frame: 16 header bytes, big-endian, then the body.
//   0 0x5A | 1 version | 2-3 sequence | 4-7 body length | 8-9 type | 10-15 reserved
// Framing uses bytes 4-7 only. Version and reserved bytes are never checked: real robots put the request number into
// 10-11 and a compression type into 14 (FIELD-FACTS section 1.1).

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace tacho::wire {

inline constexpr std::size_t kHeaderBytes = 16;
inline constexpr std::uint32_t kMaxBodyBytes = 16u << 20;
inline constexpr std::uint8_t kSync = 0x5A;

inline constexpr std::uint16_t kStatusAll1 = 1100;
inline constexpr std::uint16_t kStatusIo = 1013;
/// What a robot sends unasked on its push port.
inline constexpr std::uint16_t kPush = 19301;
constexpr std::uint16_t answer_type(std::uint16_t request) { return static_cast<std::uint16_t>(request + 10000); }

struct FrameHeader {
  std::uint8_t version = 1;
  std::uint16_t sequence = 0;
  std::uint32_t length = 0;
  std::uint16_t type = 0;
  std::array<std::uint8_t, 6> reserved{};
};

struct Frame {
  FrameHeader header;
  std::array<char, kHeaderBytes> header_bytes{};
  std::string body;
};

/// A whole frame, ready to send.
std::string encode_frame(std::uint8_t version, std::uint16_t sequence, std::uint16_t type, std::string_view body,
                         std::array<std::uint8_t, 6> reserved = {});

/// True when the header of an answer to `request_type` should be kept beside the body: byte 14 (compression) set, or a
/// routing length in 12-13, which change the meaning of the body.
bool unusual_header(const FrameHeader& header);

/// Incremental decoder: feed bytes in any chunks, take frames in order. After `bad()` the connection must be closed:
/// there is no way to find the next frame for sure.
class FrameDecoder {
 public:
  explicit FrameDecoder(std::uint32_t max_body = kMaxBodyBytes) : max_body_(max_body) {}
  void feed(std::string_view bytes);
  /// Moves the next complete frame into `out`; false when there is none yet.
  [[nodiscard]] bool next(Frame& out);
  [[nodiscard]] bool bad() const { return !why_.empty(); }
  [[nodiscard]] const std::string& why() const { return why_; }  ///< in words, with the offending bytes
  [[nodiscard]] std::size_t buffered() const { return buffer_.size() - begin_; }
  void reset();

 private:
  std::uint32_t max_body_;
  std::string buffer_;
  std::size_t begin_ = 0;
  std::string why_;
};

/// What a frame is among those of `expected_type`.
enum class AnswerClass : std::uint8_t {
  expected,      ///< stored, whatever the body is
  error_frame,   ///< type 60000..60004
  client_limit,  ///< type 19204 or 19301 (the port number), ret_code 61001
  other,         ///< any other type: counted, connection closed
};
AnswerClass classify(const Frame& frame, std::uint16_t expected_type);

/// What an error frame means and what to do about it, in words; works for 60000-60004 and 61001.
std::string explain_error(const Frame& frame);

/// The same for every repetition of a refusal, whatever time or counter its body carries: type and ret_code.
std::string error_key(const Frame& frame);

}  // namespace tacho::wire
