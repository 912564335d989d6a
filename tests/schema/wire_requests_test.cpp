#include "schema/wire/requests.hpp"

#include "schema/wire/frame.hpp"
#include "tests/support/catch.hpp"

using namespace tacho::wire;

namespace {

std::string from_hex(std::string_view text) {
  std::string bytes;
  for (std::size_t i = 0; i + 1 < text.size();) {
    if (text[i] == ' ' || text[i] == '\n') {
      ++i;
      continue;
    }
    bytes.push_back(static_cast<char>(std::stoi(std::string(text.substr(i, 2)), nullptr, 16)));
    i += 2;
  }
  return bytes;
}

}  // namespace

TEST_CASE("request 1013 is the document's bytes", "[wire]") {
  CHECK(encode_frame(1, 1, kStatusIo, "") == from_hex("5A 01 00 01 00 00 00 00 03 F5 00 00 00 00 00 00"));
}

TEST_CASE("request 1100 without parameters is the document's first example", "[wire]") {
  StatusRequest request;
  request.return_laser.reset();
  const std::string body = status_request_body(request);
  CHECK(body.empty());
  CHECK(encode_frame(1, 1, kStatusAll1, body) == from_hex("5A 01 00 01 00 00 00 00 04 4C 00 00 00 00 00 00"));
}

TEST_CASE("request 1100 with parameters is the document's hex example, 83 bytes", "[wire]") {
  // The document's JSON has return_mid360 too, its bytes have not; the bytes rule.
  StatusRequest request;
  request.keys = {"last_station", "current_map"};
  request.return_laser = false;
  request.return_beams3d = false;
  const std::string frame = encode_frame(1, 1, kStatusAll1, status_request_body(request));
  CHECK(frame.size() == 16 + 83);
  CHECK(frame == from_hex("5A 01 00 01 00 00 00 53 04 4C 00 00 00 00 00 00\n"
                          "7B 22 6B 65 79 73 22 3A 5B 22 6C 61 73 74 5F 73\n"
                          "74 61 74 69 6F 6E 22 2C 22 63 75 72 72 65 6E 74\n"
                          "5F 6D 61 70 22 5D 2C 22 72 65 74 75 72 6E 5F 6C\n"
                          "61 73 65 72 22 3A 66 61 6C 73 65 2C 22 72 65 74\n"
                          "75 72 6E 5F 62 65 61 6D 73 33 44 22 3A 66 61 6C\n"
                          "73 65 7D"));
}

TEST_CASE("laser beams are not asked for unless somebody wants them", "[wire]") {
  CHECK(status_request_body({}) == "{\"return_laser\":false}");
}

TEST_CASE("every parameter of request 1100 can be set, timeout does not exist", "[wire]") {
  StatusRequest request;
  request.keys = {"a\"b\\c\n"};
  request.return_laser = true;
  request.return_beams3d = true;
  request.return_mid360 = true;
  request.language = "en";
  CHECK(status_request_body(request) ==
        "{\"keys\":[\"a\\\"b\\\\c\\u000a\"],\"return_laser\":true,\"return_beams3D\":true,\"return_mid360\":true,"
        "\"language\":\"en\"}");
  CHECK(status_request_body(request).find("timeout") == std::string::npos);
}

TEST_CASE("the keys of a body are found whatever it is, and an answer to more keys than asked is told") {
  using Keys = std::vector<std::string_view>;
  CHECK(member_keys("{}").empty());
  CHECK(member_keys(R"( { "a" : 1 , "b":[{"c":2},"}"],"d\"":{"e":"\"}"}} )") == Keys{"a", "b", R"(d\")"});
  CHECK(member_keys(R"({"a":)") == Keys{"a"});
  CHECK(member_keys(R"({"a)").size() == 1);
  CHECK(member_keys(R"({")").size() == 1);
  for (const char* body : {"", "[1,2]", "\\\"", "not json", "\"a\":1"}) {
    CHECK(member_keys(body).empty());
  }
  CHECK_FALSE(ignores_keys(R"({"x":1,"create_on":"now","ret_code":0})", 1));
  std::string whole = R"({"x":1)";
  for (int key = 0; key < 20; ++key) {
    whole += ",\"k" + std::to_string(key) + "\":0";
  }
  CHECK(ignores_keys(whole + "}", 8));
}
