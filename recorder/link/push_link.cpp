#include "recorder/link/push_link.hpp"

#include <fmt/format.h>

#include <array>
#include <utility>

#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr Micros kLongestSilence = 20'000'000;

}  // namespace

void PushLink::close() {
  socket_.close();
  decoder_.reset();
  cut_ = false;
}

PollResult PushLink::poll(Source, std::chrono::milliseconds timeout) {
  PollResult result;
  const Micros deadline_us = mono_now_us() + std::chrono::microseconds(timeout).count();
  Failure failure;
  if (!socket_.connected()) {
    decoder_.reset();
    failure = socket_.connect(deadline_us);
    silent_since_us_ = mono_now_us();
  }
  wire::Frame frame;
  if (!failure.failed) {
    failure = receive(frame, deadline_us);
  }
  if (!failure.failed) {
    result.t_send_us = result.t_recv_us = wall_now_us();
    silent_since_us_ = mono_now_us();
    cut_ = false;
    judge(std::move(frame), result);
    return result;
  }
  result.cause = socket_.interrupted() ? Cause::shutdown : failure.cause;
  result.detail = std::move(failure.detail);
  // Half a push may just be cut by this deadline. One that is cut by the next one as well is out of step: it would grow
  // for ever.
  const bool cut_before = std::exchange(cut_, decoder_.buffered() > 0);
  const bool quiet = failure.cause == Cause::timeout && !(cut_ && cut_before) && socket_.connected();
  if (!quiet || mono_now_us() - silent_since_us_ > kLongestSilence) {
    close();
  }
  return result;
}

Failure PushLink::receive(wire::Frame& frame, Micros deadline_us) {
  std::array<char, 65536> buffer;  // uninitialised on purpose: written by receive
  while (!decoder_.next(frame)) {
    if (decoder_.bad()) {
      return {true, Cause::malformed,
              fmt::format("{}: {}; is this a robot's push port (19301)?", socket_.address(), decoder_.why())};
    }
    Received got = socket_.receive(buffer, deadline_us);
    if (got.failure.failed) {
      if (got.failure.cause == Cause::timeout) {
        got.failure.detail = decoder_.buffered() == 0
                                 ? fmt::format("{}: connected, but nothing is pushed", socket_.address())
                                 : fmt::format("{}: only {} bytes of a push", socket_.address(), decoder_.buffered());
      }
      return got.failure;
    }
    decoder_.feed(got.bytes);
  }
  return {};
}

void PushLink::judge(wire::Frame frame, PollResult& result) {
  const wire::AnswerClass what = wire::classify(frame, wire::kPush);
  const bool full = what == wire::AnswerClass::client_limit;
  switch (what) {
    case wire::AnswerClass::expected:
      result.ok = true;
      last_error_.clear();
      result.header = wire::unusual_header(frame.header)
                          ? std::string(frame.header_bytes.data(), frame.header_bytes.size())
                          : std::string();
      result.body = std::move(frame.body);
      return;
    case wire::AnswerClass::error_frame:
    case wire::AnswerClass::client_limit:
      result.cause = full ? Cause::client_limit : Cause::error_frame;
      result.detail = fmt::format("{}: {}", socket_.address(), wire::explain_error(frame));
      if (std::string key = wire::error_key(frame); std::exchange(last_error_, key) != key) {
        result.notes.push_back({full ? EventKind::client_limit : EventKind::error_frame,
                                std::to_string(frame.header.type),
                                {},
                                {},
                                wire::explain_error(frame)});
      }
      break;
    case wire::AnswerClass::other:
      result.cause = Cause::malformed;
      result.detail = fmt::format("{}: a frame of type {} came where pushes ({}) come", socket_.address(),
                                  frame.header.type, wire::kPush);
      break;
  }
  close();
}

}  // namespace tacho::recorder
