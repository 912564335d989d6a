#include "analyzer/report/manifest.hpp"

#include <openssl/evp.h>

#include <array>
#include <cassert>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "analyzer/report/json_layout.hpp"
#include "schema/error.hpp"
#include "schema/time.hpp"

namespace tacho::report {
namespace {

using Json = nlohmann::ordered_json;
constexpr const char* kFormat = "tachograph-manifest";

class Sha256 {
 public:
  Sha256() : context_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) {
    const int ok = EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr);
    assert(ok == 1);
    static_cast<void>(ok);
  }
  void add(std::string_view bytes) { EVP_DigestUpdate(context_.get(), bytes.data(), bytes.size()); }
  std::string hex() {
    std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
    unsigned int length = 0;
    EVP_DigestFinal_ex(context_.get(), digest.data(), &length);
    constexpr std::string_view digits = "0123456789abcdef";
    std::string out;
    for (unsigned int i = 0; i < length; ++i) {
      out += digits[digest[i] >> 4];
      out += digits[digest[i] & 15];
    }
    return out;
  }

 private:
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

Json digest_json(const FileDigest& file) {
  return {{"name", file.name}, {"bytes", file.bytes}, {"sha256", file.sha256}};
}

Json time_or_null(Micros t_us, Micros none) { return t_us == none ? Json(nullptr) : Json(iso_utc(t_us)); }

std::string robot_name(const std::vector<Robot>& robots, RobotId id) {
  for (const Robot& robot : robots) {
    if (robot.id == id) {
      return robot.name;
    }
  }
  return std::to_string(id);
}

Json coverage_json(const Coverage& c, const std::vector<Robot>& robots) {
  return {{"robot", robot_name(robots, c.robot)},
          {"source", source_name(c.source)},
          {"planned", c.planned},
          {"stored", c.stored},
          {"missed", c.missed},
          {"partial", c.partial},
          {"undecodable", c.undecodable},
          {"body_bytes", c.bytes},
          {"first", time_or_null(c.first_us, 0)},
          {"last", time_or_null(c.last_us, 0)}};
}

bool stays_inside(const std::string& name) {
  const std::filesystem::path path(name);
  if (name.empty() || path.is_absolute()) {
    return false;
  }
  for (const std::filesystem::path& part : path) {
    if (part == "..") {
      return false;
    }
  }
  return true;
}

}  // namespace

std::string sha256(std::string_view bytes) {
  Sha256 hash;
  hash.add(bytes);
  return hash.hex();
}

std::string sha256_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) {
    throw Error(file.string(), "cannot be read", "check its permissions");
  }
  Sha256 hash;
  std::vector<char> buffer(1U << 20);
  while (in.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) || in.gcount() > 0) {
    hash.add({buffer.data(), static_cast<std::size_t>(in.gcount())});
  }
  return hash.hex();
}

std::string manifest_text(const Manifest& m) {
  const Window open;
  Json out;
  out["format"] = kFormat;
  out["version"] = kJsonVersion;
  out["tool"] = m.origin.tool;
  out["from"] = time_or_null(m.origin.window.from_us, open.from_us);
  out["to"] = time_or_null(m.origin.window.to_us, open.to_us);
  out["zone"] = m.origin.zone;
  out["robots"] = m.origin.robots;
  out["config"] = m.config.name.empty() ? Json("defaults") : digest_json(m.config);
  out["input"] = Json::array();
  for (const FileDigest& part : m.input) {
    out["input"].push_back(digest_json(part));
  }
  out["coverage"] = Json::array();
  for (const Coverage& c : m.coverage) {
    out["coverage"].push_back(coverage_json(c, m.robots));
  }
  out["files"] = Json::array();
  for (const FileDigest& file : m.files) {
    out["files"].push_back(digest_json(file));
  }
  return laid_out(out);
}

std::vector<std::string> files_of_manifest(std::string_view text) {
  std::vector<std::string> names;
  const Json document = Json::parse(text, nullptr, false);
  if (!document.is_object() || document.value("format", Json()) != kFormat || !document.contains("files") ||
      !document["files"].is_array()) {
    return names;
  }
  for (const Json& file : document["files"]) {
    if (file.is_object() && file.contains("name") && file["name"].is_string() &&
        stays_inside(file["name"].get<std::string>())) {
      names.push_back(file["name"].get<std::string>());
    }
  }
  return names;
}

}  // namespace tacho::report
