#include "recorder/link/tcp_link.hpp"

#include <fmt/format.h>

#include <cassert>
#include <utility>

#include "schema/time.hpp"
#include "schema/wire/requests.hpp"

namespace tacho::recorder {

namespace {

constexpr int kStrangeConnections = 3;
constexpr int kMatchesToBelieve = 3;
constexpr std::size_t kMaxErrorText = 2u << 10;

std::string hex(const std::array<char, wire::kHeaderBytes>& bytes) {
  std::string text;
  for (const char byte : bytes) {
    text += fmt::format("{}{:02X}", text.empty() ? "" : " ", static_cast<unsigned char>(byte));
  }
  return text;
}

std::uint16_t request_of(Source source) {
  assert(source_info(source).protocol == Protocol::status_port);
  return source == Source::io ? wire::kStatusIo : wire::kStatusAll1;
}

}  // namespace

TcpLink::TcpLink(TcpLinkOptions options) : options_(std::move(options)), socket_(options_.host, options_.port) {}

void TcpLink::close() {
  socket_.close();
  decoder_.reset();
}

Failure TcpLink::ready(Micros deadline_us) {
  // An idle connection that was closed, or that holds bytes nobody asked for, is replaced before it costs a poll.
  if (socket_.connected() && socket_.idle() != Socket::Idle::ok) {
    close();
  }
  if (socket_.connected()) {
    return {};
  }
  decoder_.reset();
  fresh_ = true;
  return socket_.connect(deadline_us);
}

Failure TcpLink::receive(wire::Frame& frame, Micros deadline_us) {
  std::array<char, 65536> buffer;  // uninitialised on purpose: written by receive
  for (;;) {
    Received got = socket_.receive(buffer, deadline_us);
    const std::size_t buffered = decoder_.buffered();
    if (got.failure.failed && got.failure.cause == Cause::timeout) {
      got.failure.detail = buffered == 0 ? fmt::format("{}: connected, but no answer", socket_.address())
                                         : fmt::format("{}: only {} bytes of an answer", socket_.address(), buffered);
    } else if (got.failure.failed && buffered > 0) {
      got.failure.detail += fmt::format(" after {} bytes", buffered);
    }
    if (got.failure.failed) {
      return got.failure;
    }
    decoder_.feed(got.bytes);
    if (decoder_.next(frame)) {
      return {};
    }
    if (decoder_.bad()) {
      return {true, Cause::malformed,
              fmt::format("{}: {}; is this a robot's status port (19204)?", socket_.address(), decoder_.why())};
    }
  }
}

PollResult TcpLink::poll(Source source, std::chrono::milliseconds timeout) {
  PollResult result;
  const Micros deadline_us = mono_now_us() + std::chrono::microseconds(timeout).count();
  wire::Frame frame;

  Failure failure = ready(deadline_us);
  const Micros sent_us = mono_now_us();
  if (!failure.failed) {
    ++sequence_;
    const std::string bytes = wire::encode_frame(options_.version, sequence_, request_of(source), body_of(source));
    failure = socket_.send(bytes, deadline_us);
  }
  if (!failure.failed) {
    failure = receive(frame, deadline_us);
    result.t_recv_us = wall_now_us();
    result.t_send_us = result.t_recv_us - (mono_now_us() - sent_us);  // a clock that is set makes no round trip long
  }
  if (failure.failed) {
    close();
    result.cause = socket_.interrupted() ? Cause::shutdown : failure.cause;
    result.detail = std::move(failure.detail);
    return result;
  }
  const bool trailing = decoder_.buffered() > 0;
  const bool first = std::exchange(fresh_, false);
  judge(frame, first, source, result);
  if (trailing) {
    close();  // more than one answer to one question: this connection is out of step
    result.cause = result.ok ? Cause::malformed : result.cause;
  }
  if (result.ok) {
    result.header = wire::unusual_header(frame.header)
                        ? std::string(frame.header_bytes.data(), frame.header_bytes.size())
                        : std::string();
    if (source == Source::status && options_.hint) {
      options_.hint->heard(frame.body);
    }
    result.body = std::move(frame.body);
    if (source == Source::pose && wire::ignores_keys(result.body, kPoseKeys.size())) {
      result.give_up = fmt::format(
          "asked for {} keys, the controller answered with {}: it ignores `keys`, so pose is "
          "not asked for any more; switch pose off, or ask status more often",
          kPoseKeys.size(), wire::member_keys(result.body).size());
    }
  }
  return result;
}

std::string_view TcpLink::body_of(Source source) const {
  static const std::string pose = wire::pose_request_body();
  switch (source) {
    case Source::status:
      return options_.status_body;
    case Source::pose:
      return pose;
    case Source::ring:
      return options_.ring_body;
    default:
      return {};
  }
}

void TcpLink::judge(const wire::Frame& frame, bool first, Source source, PollResult& result) {
  const std::uint16_t request = request_of(source);
  switch (wire::classify(frame, wire::answer_type(request))) {
    case wire::AnswerClass::expected:
      judge_sequence(frame, first, result);
      if (result.ok) {
        last_error_[static_cast<std::size_t>(source)].clear();
      }
      return;
    case wire::AnswerClass::error_frame:
      result.cause = Cause::error_frame;
      result.detail = fmt::format("{}: {}", socket_.address(), wire::explain_error(frame));
      note_error(frame, source, EventKind::error_frame, result);
      if (echoes_ && frame.header.sequence != sequence_) {
        close();
      }
      return;
    case wire::AnswerClass::client_limit:
      result.cause = Cause::client_limit;
      result.detail = fmt::format("{}: {}", socket_.address(), wire::explain_error(frame));
      note_error(frame, source, EventKind::client_limit, result);
      close();
      return;
    case wire::AnswerClass::other:
      result.cause = Cause::malformed;
      result.detail = fmt::format("{}: a frame of type {} came where {} was asked for", socket_.address(),
                                  frame.header.type, wire::answer_type(request));
      close();
      return;
  }
}

void TcpLink::judge_sequence(const wire::Frame& frame, bool first, PollResult& result) {
  const bool matches = frame.header.sequence == sequence_;
  result.ok = matches || !echoes_;
  if (!echoes_) {
    // Numbers that are not echoed do not match several times in a row: the robot was judged too fast, or was replaced.
    matches_ = matches ? matches_ + 1 : 0;
    echoes_ = matches_ >= kMatchesToBelieve;
  }
  if (result.ok) {
    strange_connections_ = matches ? 0 : strange_connections_;
    return;
  }
  // The first answer of a connection cannot be a late one: nothing was asked before on it.
  strange_connections_ = first ? strange_connections_ + 1 : 0;
  result.cause = Cause::wrong_sequence;
  result.detail = fmt::format("{}: asked with sequence number {}, answered with {}", socket_.address(), sequence_,
                              frame.header.sequence);
  if (strange_connections_ >= kStrangeConnections) {
    strange_connections_ = 0;
    matches_ = 0;
    echoes_ = false;
    result.notes.push_back({EventKind::no_sequence_echo,
                            {},
                            {},
                            {},
                            fmt::format("{} fresh connections in a row answered with another sequence number; it is "
                                        "not compared until {} answers in a row have the right one",
                                        kStrangeConnections, kMatchesToBelieve)});
  }
  close();
}

void TcpLink::note_error(const wire::Frame& frame, Source source, EventKind kind, PollResult& result) {
  std::string key = wire::error_key(frame);
  std::string& last = last_error_[static_cast<std::size_t>(source)];
  if (last != key) {
    last = std::move(key);
    result.notes.push_back({kind,
                            std::to_string(frame.header.type),
                            {},
                            {},
                            fmt::format("{}; header {}; body {}", wire::explain_error(frame), hex(frame.header_bytes),
                                        std::string_view(frame.body).substr(0, kMaxErrorText))});
  }
}

}  // namespace tacho::recorder
