// The push link against a server that misbehaves on purpose.

#include "recorder/link/push_link.hpp"
#include "tests/recorder/tiny_server.hpp"
#include "tests/support/catch.hpp"

using namespace tacho;
using namespace tacho::recorder;
using namespace tacho::recorder::test;
using namespace std::chrono_literals;

namespace {

constexpr auto kTimeout = 2000ms;
constexpr auto kShort = 80ms;

std::string pushed(const std::string& body) { return wire::encode_frame(1, 0, 19301, body); }

}  // namespace

TEST_CASE("pushes are taken one by one, in order, whatever the packets") {
  TinyServer server([](Peer& peer, int) {
    const std::string all = pushed("{\"x\":1}") + pushed("{\"x\":2}") + pushed("");
    peer.write(all.substr(0, 10));
    std::this_thread::sleep_for(20ms);
    peer.write(all.substr(10));
    peer.wait_closed();
  });
  PushLink link("127.0.0.1", server.port());
  for (const char* body : {"{\"x\":1}", "{\"x\":2}", ""}) {
    const PollResult result = link.poll(Source::push, kTimeout);
    CHECK(result.ok);
    CHECK(result.body == body);
    CHECK(result.t_send_us == result.t_recv_us);
    CHECK(result.t_recv_us > 0);
  }
}

TEST_CASE("silence does not close the connection, and the push after it is taken") {
  std::atomic<bool> go{false};
  TinyServer server([&](Peer& peer, int) {
    while (!go && peer.alive()) {
      std::this_thread::sleep_for(5ms);
    }
    peer.write(pushed("{}"));
    peer.wait_closed();
  });
  PushLink link("127.0.0.1", server.port());
  const PollResult silent = link.poll(Source::push, kShort);
  CHECK_FALSE(silent.ok);
  CHECK(silent.cause == Cause::timeout);
  CHECK(link.connected());
  go = true;
  CHECK(link.poll(Source::push, kTimeout).ok);
}

TEST_CASE("half a push that does not go on, another frame and bytes that are none close the connection") {
  const auto outcome = [](const std::string& bytes) {
    TinyServer server([&](Peer& peer, int) {
      peer.write(bytes);
      peer.wait_closed();
    });
    PushLink link("127.0.0.1", server.port());
    PollResult result = link.poll(Source::push, kShort);
    if (result.cause == Cause::timeout) {
      CHECK(link.connected());  // it may still go on
      result = link.poll(Source::push, kShort);
    }
    CHECK_FALSE(result.ok);
    CHECK_FALSE(link.connected());
    return result;
  };
  CHECK(outcome(pushed("{\"x\":1}").substr(0, 20)).cause == Cause::timeout);
  const PollResult other = outcome(wire::encode_frame(1, 3, 11100, "{}"));
  CHECK(other.cause == Cause::malformed);
  CHECK(other.detail.find("11100") != std::string::npos);
  CHECK(outcome("HTTP/1.1 400 Bad Request").cause == Cause::malformed);
}

TEST_CASE("a push that a deadline cuts in the middle is taken by the next poll") {
  TinyServer server([](Peer& peer, int) {
    const std::string all = pushed("{\"x\":1}") + pushed("{\"x\":2}");
    peer.write(all.substr(0, 20));
    std::this_thread::sleep_for(3 * kShort / 2);
    peer.write(all.substr(20));
    peer.wait_closed();
  });
  PushLink link("127.0.0.1", server.port());
  CHECK(link.poll(Source::push, kShort).cause == Cause::timeout);
  CHECK(link.poll(Source::push, kTimeout).body == "{\"x\":1}");
  CHECK(link.poll(Source::push, kTimeout).body == "{\"x\":2}");
  CHECK(server.connections() == 1);
}

TEST_CASE("the beginning of a push that came with the one before it may be cut by a deadline like any other") {
  TinyServer server([](Peer& peer, int) {
    const std::string next = pushed("{\"x\":2}");
    peer.write(pushed("{\"x\":1}") + next.substr(0, 20));
    std::this_thread::sleep_for(3 * kShort / 2);
    peer.write(next.substr(20));
    peer.wait_closed();
  });
  PushLink link("127.0.0.1", server.port());
  CHECK(link.poll(Source::push, kTimeout).body == "{\"x\":1}");
  CHECK(link.poll(Source::push, kShort).cause == Cause::timeout);
  CHECK(link.poll(Source::push, kTimeout).body == "{\"x\":2}");
  CHECK(server.connections() == 1);
}

TEST_CASE("a robot with too many clients on its push port says so in words, as one event") {
  TinyServer server([](Peer& peer, int connection) {
    peer.write(wire::encode_frame(1, 0, 19301,
                                  R"({"ret_code":61001,"err_msg":"connection limit reached","create_on":")" +
                                      std::to_string(connection) + "\"}"));
    peer.wait_closed();
  });
  PushLink link("127.0.0.1", server.port());
  PollResult result = link.poll(Source::push, kTimeout);
  CHECK(result.cause == Cause::client_limit);
  CHECK(result.detail.find("19301") != std::string::npos);
  REQUIRE(result.notes.size() == 1);
  CHECK(result.notes[0].kind == EventKind::client_limit);
  result = link.poll(Source::push, kTimeout);
  CHECK(result.cause == Cause::client_limit);
  CHECK(result.notes.empty());
}

TEST_CASE("nothing is ever sent to the push port") {
  std::string heard;
  {
    TinyServer server([&](Peer& peer, int) {
      peer.write(pushed("{}"));
      heard += peer.read(1);
    });
    PushLink link("127.0.0.1", server.port());
    CHECK(link.poll(Source::push, kTimeout).ok);
    CHECK_FALSE(link.poll(Source::push, kShort).ok);
    link.close();
  }
  CHECK(heard == "");
}
