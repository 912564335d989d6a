// The status link against a server that misbehaves on purpose.

#include "recorder/link/tcp_link.hpp"
#include "schema/wire/requests.hpp"
#include "tests/recorder/tiny_server.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace std::chrono_literals;

namespace {

constexpr auto kTimeout = 2000ms;  // generous: only tests about timeouts wait for one
constexpr auto kShort = 80ms;

TcpLink link_to(std::uint16_t port) { return TcpLink({"127.0.0.1", port, 1, wire::status_request_body({})}); }

/// Reads one request and gives its header.
wire::FrameHeader request(Peer& peer, std::string* body = nullptr) {
  wire::FrameDecoder decoder;
  wire::Frame frame;
  while (!decoder.next(frame)) {
    const std::string byte = peer.read(1);
    if (byte.empty()) {
      return {};
    }
    decoder.feed(byte);
  }
  if (body != nullptr) {
    *body = frame.body;
  }
  return frame.header;
}

std::string answer(const wire::FrameHeader& to, const std::string& body) {
  return wire::encode_frame(1, to.sequence, wire::answer_type(to.type), body);
}

/// Answers every request with `body` and the number of the request, until the client goes away.
void serve_all(Peer& peer, const std::string& body = R"({"x":1})") {
  for (wire::FrameHeader header = request(peer); header.type != 0; header = request(peer)) {
    peer.write(answer(header, body));
  }
}

}  // namespace

TEST_CASE("requests 1100 and 1013 are asked on one held connection with counting sequence numbers") {
  std::vector<wire::FrameHeader> seen;
  std::vector<std::string> bodies;
  {
    TinyServer server([&](Peer& peer, int) {
      std::string body;
      for (wire::FrameHeader header = request(peer, &body); header.type != 0; header = request(peer, &body)) {
        seen.push_back(header);
        bodies.push_back(body);
        peer.write(answer(header, "{}"));
      }
    });
    TcpLink link = link_to(server.port());
    CHECK(link.poll(Source::status, kTimeout).ok);
    CHECK(link.poll(Source::io, kTimeout).ok);
    CHECK(link.poll(Source::status, kTimeout).ok);
    CHECK(link.connected());
    CHECK(server.connections() == 1);
  }
  REQUIRE(seen.size() == 3);
  CHECK(seen[0].type == 1100);
  CHECK(seen[1].type == 1013);
  CHECK(bodies[0] == R"({"return_laser":false})");
  CHECK(bodies[1].empty());
  CHECK(seen[1].sequence == seen[0].sequence + 1);
  CHECK(seen[2].sequence == seen[1].sequence + 1);
}

TEST_CASE("an answer that arrives byte by byte is taken whole") {
  const std::string body(300, 'x');
  TinyServer server([&](Peer& peer, int) {
    const std::string bytes = answer(request(peer), body);
    for (const char byte : bytes) {
      peer.write(std::string(1, byte));
    }
    peer.wait_closed();
  });
  TcpLink link = link_to(server.port());
  const PollResult result = link.poll(Source::status, kTimeout);
  REQUIRE(result.ok);
  CHECK(result.body == body);
  CHECK(result.header.empty());
  CHECK(result.t_recv_us >= result.t_send_us);
}

TEST_CASE("a compressed or routed answer is kept with its header") {
  TinyServer server([&](Peer& peer, int) {
    const wire::FrameHeader header = request(peer);
    peer.write(wire::encode_frame(2, header.sequence, 11100, "\x1f\x8b", {0x04, 0x4C, 0, 0, 1, 0}));
    peer.wait_closed();
  });
  TcpLink link = link_to(server.port());
  const PollResult result = link.poll(Source::status, kTimeout);
  REQUIRE(result.ok);
  CHECK(result.body == "\x1f\x8b");
  CHECK(result.header.size() == wire::kHeaderBytes);
}

TEST_CASE("a late answer is never taken for the next one") {
  std::atomic<bool> late{false};
  TinyServer server([&](Peer& peer, int n) {
    if (n == 0) {
      const wire::FrameHeader header = request(peer);
      while (!late) {
        std::this_thread::sleep_for(1ms);
      }
      peer.write(answer(header, R"({"late":1})"));
    }
    serve_all(peer, R"({"fresh":1})");
  });
  TcpLink link = link_to(server.port());
  const PollResult first = link.poll(Source::status, kShort);
  CHECK_FALSE(first.ok);
  CHECK(first.cause == Cause::timeout);
  CHECK_FALSE(link.connected());
  late = true;
  for (int i = 0; i < 3; ++i) {
    const PollResult next = link.poll(Source::status, kTimeout);
    REQUIRE(next.ok);
    CHECK(next.body == R"({"fresh":1})");
  }
}

TEST_CASE("a duplicated answer closes the connection and costs no later poll its value") {
  TinyServer server([&](Peer& peer, int n) {
    if (n == 0) {
      const std::string bytes = answer(request(peer), R"({"n":0})");
      peer.write(bytes + bytes);
      peer.wait_closed();
    } else {
      serve_all(peer, R"({"n":1})");
    }
  });
  TcpLink link = link_to(server.port());
  const PollResult first = link.poll(Source::status, kTimeout);
  REQUIRE(first.ok);
  CHECK(first.body == R"({"n":0})");
  const PollResult second = link.poll(Source::status, kTimeout);
  REQUIRE(second.ok);
  CHECK(second.body == R"({"n":1})");
  CHECK(server.connections() == 2);
}

TEST_CASE("another sequence number is no answer and closes the connection") {
  TinyServer server([&](Peer& peer, int n) {
    wire::FrameHeader header = request(peer);
    if (n == 0) {
      peer.write(answer(header, "{}"));
      header = request(peer);
      --header.sequence;
      peer.write(answer(header, "{}"));
      peer.wait_closed();
    } else {
      peer.write(answer(header, "{}"));
      serve_all(peer);
    }
  });
  TcpLink link = link_to(server.port());
  REQUIRE(link.poll(Source::status, kTimeout).ok);
  const PollResult wrong = link.poll(Source::status, kTimeout);
  CHECK_FALSE(wrong.ok);
  CHECK(wrong.cause == Cause::wrong_sequence);
  CHECK(wrong.notes.empty());
  CHECK_FALSE(link.connected());
  CHECK(link.poll(Source::status, kTimeout).ok);
  CHECK(link.echoes_sequence());
}

TEST_CASE("only three fresh connections in a row make a robot one that does not echo sequence numbers") {
  TinyServer server([&](Peer& peer, int) {
    for (wire::FrameHeader header = request(peer); header.type != 0; header = request(peer)) {
      header.sequence = static_cast<std::uint16_t>(header.sequence + 1000);
      peer.write(answer(header, "{}"));
    }
  });
  TcpLink link = link_to(server.port());
  for (int i = 0; i < 2; ++i) {
    const PollResult result = link.poll(Source::status, kTimeout);
    CHECK(result.cause == Cause::wrong_sequence);
    CHECK(result.notes.empty());
    CHECK(link.echoes_sequence());
  }
  const PollResult third = link.poll(Source::status, kTimeout);
  CHECK_FALSE(third.ok);
  REQUIRE(third.notes.size() == 1);
  CHECK(third.notes[0].kind == EventKind::no_sequence_echo);
  CHECK_FALSE(link.echoes_sequence());
  CHECK(link.poll(Source::status, kTimeout).ok);
  CHECK(link.poll(Source::io, kTimeout).ok);
}

TEST_CASE("three right numbers in a row end the judgement that a robot does not echo them") {
  std::atomic<int> wrong{6};  // three to be judged, and three more that are taken all the same
  TinyServer server([&](Peer& peer, int) {
    for (wire::FrameHeader header = request(peer); header.type != 0; header = request(peer)) {
      header.sequence = static_cast<std::uint16_t>(header.sequence + (wrong-- > 0 ? 500 : 0));
      peer.write(answer(header, "{}"));
    }
  });
  TcpLink link = link_to(server.port());
  for (int i = 0; i < 8; ++i) {
    CHECK(link.poll(Source::status, kTimeout).ok == (i >= 3));
    CHECK(link.echoes_sequence() == (i < 2));
  }
  CHECK(link.poll(Source::status, kTimeout).ok);
  CHECK(link.echoes_sequence());
  wrong = 1;
  CHECK(link.poll(Source::status, kTimeout).cause == Cause::wrong_sequence);
}

TEST_CASE("the error frames of the vendor's list are explained in words, each with a remedy") {
  for (const auto& [type, words] :
       {std::pair{60000, "19204"}, {60001, "firmware"}, {60002, "JSON"}, {60003, "version"}, {60004, "large"}}) {
    TinyServer server([type = type](Peer& peer, int) {
      const wire::FrameHeader header = request(peer);
      peer.write(wire::encode_frame(1, header.sequence, static_cast<std::uint16_t>(type), ""));
      peer.wait_closed();
    });
    TcpLink link = link_to(server.port());
    const PollResult result = link.poll(Source::status, kTimeout);
    CHECK(result.cause == Cause::error_frame);
    INFO(result.detail);
    CHECK(result.detail.find(std::to_string(type)) != std::string::npos);
    CHECK(result.detail.find(words) != std::string::npos);
    CHECK(result.notes.size() == 1);
    CHECK(link.connected());
  }
}

TEST_CASE("bodies that are no JSON are answers and kept as they are") {
  for (const std::string& body : {std::string(), std::string("oops"), std::string("\xFF\xFE{\x00", 4)}) {
    TinyServer server([&](Peer& peer, int) { serve_all(peer, body); });
    TcpLink link = link_to(server.port());
    const PollResult result = link.poll(Source::status, kTimeout);
    CHECK(result.ok);
    CHECK(result.body == body);
  }
}

TEST_CASE("an answer that drips longer than the timeout is a timeout, however many bytes keep coming") {
  TinyServer server([&](Peer& peer, int) {
    const std::string bytes = answer(request(peer), std::string(5000, ' '));
    for (std::size_t at = 0; at < bytes.size() && peer.alive(); ++at) {
      peer.write(bytes.substr(at, 1));
      std::this_thread::sleep_for(1ms);
    }
  });
  TcpLink link = link_to(server.port());
  const PollResult result = link.poll(Source::status, kShort);
  CHECK(result.cause == Cause::timeout);
  CHECK(result.detail.find("bytes of an answer") != std::string::npos);
  CHECK_FALSE(link.connected());
}

TEST_CASE("a good answer in between starts the count of strange connections again") {
  TinyServer server([&](Peer& peer, int n) {
    wire::FrameHeader header = request(peer);
    header.sequence = static_cast<std::uint16_t>(header.sequence + (n == 2 ? 0 : 1));
    peer.write(answer(header, "{}"));
    if (n != 2) {
      peer.wait_closed();
    }
  });
  TcpLink link = link_to(server.port());
  for (int i = 0; i < 5; ++i) {
    CHECK(link.poll(Source::status, kTimeout).ok == (i == 2));
    link.close();
  }
  CHECK(link.echoes_sequence());
}

TEST_CASE("a standing refusal is words for every gap but one event, and leaves the connection open") {
  // Real ones carry the time they were made at.
  const auto refusal = [](const wire::FrameHeader& h) {
    const std::string body = R"({"err_msg":"unknown","create_on":")" + std::to_string(h.sequence) + "\"}";
    return wire::encode_frame(1, h.sequence, 60001, body);
  };
  TinyServer server([&](Peer& peer, int) {
    for (wire::FrameHeader header = request(peer); header.type != 0; header = request(peer)) {
      peer.write(header.type == 1013 ? refusal(header) : answer(header, "{}"));
    }
  });
  TcpLink link = link_to(server.port());
  const PollResult first = link.poll(Source::io, kTimeout);
  CHECK(first.cause == Cause::error_frame);
  CHECK(first.detail.find("60001") != std::string::npos);
  REQUIRE(first.notes.size() == 1);
  CHECK(first.notes[0].kind == EventKind::error_frame);
  CHECK(first.notes[0].detail.find("unknown") != std::string::npos);
  CHECK(first.notes[0].detail.find("5A 01") != std::string::npos);
  CHECK(link.poll(Source::status, kTimeout).ok);
  const PollResult again = link.poll(Source::io, kTimeout);
  CHECK(again.cause == Cause::error_frame);
  CHECK(again.notes.empty());
  CHECK(server.connections() == 1);
}

TEST_CASE("a robot with too many clients is recognised and the connection given up") {
  TinyServer server([&](Peer& peer, int) {
    peer.write(wire::encode_frame(1, 0, 19204, R"({"ret_code":61001,"ip":"10.0.0.1","port":19204})"));
    peer.wait_closed();
  });
  TcpLink link = link_to(server.port());
  const PollResult result = link.poll(Source::status, kTimeout);
  CHECK_FALSE(result.ok);
  CHECK(result.cause == Cause::client_limit);
  REQUIRE(result.notes.size() == 1);
  CHECK(result.notes[0].kind == EventKind::client_limit);
  CHECK_FALSE(link.connected());
}

TEST_CASE("frames that are none, too long, cut short or of another type are gaps with words") {
  const auto with = [](const std::function<std::string(const wire::FrameHeader&)>& reply) {
    TinyServer server([&](Peer& peer, int) { peer.write(reply(request(peer))); });
    TcpLink link = link_to(server.port());
    const PollResult result = link.poll(Source::status, kTimeout);
    CHECK_FALSE(result.ok);
    CHECK_FALSE(link.connected());
    CHECK(result.body.empty());
    return result;
  };
  const PollResult no_frame = with([](const auto&) { return "HTTP/1.1 400 Bad Request\r\n\r\n"; });
  CHECK(no_frame.cause == Cause::malformed);
  CHECK(no_frame.detail.find("19204") != std::string::npos);
  const PollResult huge = with([](const auto& header) {
    std::string bytes = answer(header, "{}");
    bytes[4] = '\x7F';
    return bytes;
  });
  CHECK(huge.cause == Cause::malformed);
  const PollResult cut = with([](const auto& header) { return answer(header, R"({"x":1})").substr(0, 20); });
  CHECK(cut.cause == Cause::closed);
  CHECK(cut.detail.find("20 bytes") != std::string::npos);
  const PollResult other = with([](const auto& header) { return wire::encode_frame(1, header.sequence, 11013, "{}"); });
  CHECK(other.cause == Cause::malformed);
  CHECK(other.detail.find("11013") != std::string::npos);
}

TEST_CASE("a connection closed while idle is replaced without losing a poll") {
  TinyServer server([&](Peer& peer, int) { peer.write(answer(request(peer), "{}")); });
  TcpLink link = link_to(server.port());
  for (int i = 0; i < 3; ++i) {
    REQUIRE(link.poll(Source::status, kTimeout).ok);
    while (server.connections() == i) {
      std::this_thread::sleep_for(1ms);
    }
    std::this_thread::sleep_for(20ms);  // until the server has closed its side
  }
  CHECK(server.connections() == 3);
}

TEST_CASE("a closed port is refused, an unknown name is told apart") {
  TcpLink refused = link_to(closed_port());
  const PollResult result = refused.poll(Source::status, kTimeout);
  CHECK(result.cause == Cause::connect_refused);
  CHECK(result.detail.find("refused") != std::string::npos);
  TcpLink nameless({"no.such.robot.invalid", 19204, 1, {}});
  CHECK(nameless.poll(Source::status, kTimeout).cause == Cause::unreachable);
}

TEST_CASE("a robot that accepts and stays silent is a timeout and the connection is closed") {
  TinyServer server([&](Peer& peer, int) { peer.wait_closed(); });
  TcpLink link = link_to(server.port());
  const PollResult result = link.poll(Source::status, kShort);
  CHECK(result.cause == Cause::timeout);
  CHECK_FALSE(link.connected());
}

TEST_CASE("interrupting ends a poll in progress") {
  TinyServer server([&](Peer& peer, int) { peer.wait_closed(); });
  TcpLink link = link_to(server.port());
  std::thread other([&] {
    while (server.connections() == 0) {
      std::this_thread::sleep_for(1ms);
    }
    link.interrupt();
  });
  const PollResult result = link.poll(Source::status, 30s);
  other.join();
  CHECK_FALSE(result.ok);
  CHECK(result.cause == Cause::shutdown);
  CHECK_FALSE(link.poll(Source::status, kTimeout).ok);
}

TEST_CASE("pose asks 1100 for its keys alone, and an answer with everything ends it") {
  std::string asked;
  std::string body =
      R"({"x":1,"y":2,"angle":0.5,"vx":0,"vy":0,"w":0,"odo":7,"confidence":0.9,"create_on":"2026-01-01T00:00:00.000Z","ret_code":0})";
  TinyServer server([&](Peer& peer, int) {
    for (wire::FrameHeader header = request(peer, &asked); header.type != 0; header = request(peer, &asked)) {
      CHECK(header.type == 1100);
      peer.write(answer(header, body));
    }
  });
  TcpLink link = link_to(server.port());
  PollResult result = link.poll(Source::pose, kTimeout);
  CHECK(result.ok);
  CHECK(result.give_up.empty());
  CHECK(asked == R"({"keys":["x","y","angle","confidence","vx","vy","w","odo"],"return_laser":false})");
  body = R"({"x":1)";
  for (int key = 0; key < 150; ++key) {
    body += ",\"key" + std::to_string(key) + "\":[{\"x\":1},\"}\\\"{\"]";
  }
  body += "}";
  result = link.poll(Source::pose, kTimeout);
  CHECK(result.ok);  // an answer is an answer
  CHECK(result.body == body);
  CHECK(result.give_up.find("asked for 8 keys, the controller answered with 151") == 0);
  CHECK(link.poll(Source::status, kTimeout).give_up.empty());  // there it is what was asked for
}
