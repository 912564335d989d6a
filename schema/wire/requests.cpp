#include "schema/wire/requests.hpp"

#include <fmt/format.h>

#include <string_view>

#include "schema/sample.hpp"

namespace tacho::wire {

namespace {

void append_string(std::string& out, std::string_view text) {
  out.push_back('"');
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out.push_back('\\');
      out.push_back(c);
    } else if (static_cast<unsigned char>(c) < 0x20) {
      out += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    } else {
      out.push_back(c);
    }
  }
  out.push_back('"');
}

void append_key(std::string& out, std::string_view key) {
  out.push_back(out.empty() ? '{' : ',');
  append_string(out, key);
  out.push_back(':');
}

void append_flag(std::string& out, std::string_view key, const std::optional<bool>& value) {
  if (value.has_value()) {
    append_key(out, key);
    out += *value ? "true" : "false";
  }
}

}  // namespace

std::string status_request_body(const StatusRequest& request) {
  std::string body;
  if (!request.keys.empty()) {
    append_key(body, "keys");
    for (std::size_t i = 0; i < request.keys.size(); ++i) {
      body.push_back(i == 0 ? '[' : ',');
      append_string(body, request.keys[i]);
    }
    body.push_back(']');
  }
  append_flag(body, "return_laser", request.return_laser);
  append_flag(body, "return_beams3D", request.return_beams3d);
  append_flag(body, "return_mid360", request.return_mid360);
  if (request.language.has_value()) {
    append_key(body, "language");
    append_string(body, *request.language);
  }
  // Nothing to say: the document's first example, a frame without a body.
  return body.empty() ? body : body + "}";
}

std::string pose_request_body() {
  StatusRequest request;
  request.keys.assign(kPoseKeys.begin(), kPoseKeys.end());
  return status_request_body(request);
}

bool ignores_keys(std::string_view body, std::size_t asked) {
  constexpr std::size_t kUsualExtras = 10;
  return member_keys(body).size() > asked + kUsualExtras;
}

}  // namespace tacho::wire
