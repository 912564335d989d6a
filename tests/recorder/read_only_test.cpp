// Read-only by construction: what could write to a robot does not occur in the recorder's sources.

#include <regex>
#include <sstream>

#include "schema/wire/frame.hpp"
#include "tests/support/catch.hpp"

namespace {

std::vector<std::filesystem::path> sources(const std::string& folder) {
  std::vector<std::filesystem::path> out;
  for (const auto& entry :
       std::filesystem::recursive_directory_iterator(std::filesystem::path(TACHO_SOURCE_DIR) / folder)) {
    if (entry.path().extension() == ".cpp" || entry.path().extension() == ".hpp") {
      out.push_back(entry.path());
    }
  }
  return out;
}

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

}  // namespace

TEST_CASE("no Modbus function but 2 and 4 is called, and only by the Modbus link") {
  const std::regex call(R"(\bmodbus_(read|write|mask|report|send|reply|receive)\w*)");
  std::size_t files = 0;
  std::map<std::string, int> calls;
  for (const auto& file : sources("recorder")) {
    ++files;
    const std::string text = text_of(file);
    for (std::sregex_iterator it(text.begin(), text.end(), call), end; it != end; ++it) {
      INFO(file);
      CHECK(file.filename() == "modbus_link.cpp");
      ++calls[it->str()];
    }
  }
  CHECK(files > 20);  // the search found the sources
  CHECK(calls == std::map<std::string, int>{{"modbus_read_input_bits", 1}, {"modbus_read_input_registers", 1}});
}

TEST_CASE("no request number but 1100 and 1013 and no control port occurs") {
  // Robokit requests that command, navigate or configure are 2000 to 6999; their ports are 19205 to 19210.
  const std::regex forbidden(R"(\b(192(00|05|06|07|08|10)|19301|[2-6]\d{3})\b)");
  const std::regex comment_or_text(R"rx("([^"\\]|\\.)*"|//[^\n]*)rx");
  for (const auto& file : sources("recorder")) {
    const std::string code = std::regex_replace(text_of(file), comment_or_text, "");
    INFO(file);
    std::smatch found;
    const bool any = std::regex_search(code, found, forbidden);
    INFO((any ? found.str() : std::string()));
    CHECK_FALSE(any);
  }
  CHECK(tacho::wire::kStatusAll1 == 1100);
  CHECK(tacho::wire::kStatusIo == 1013);
}

TEST_CASE("frames are sent by the status link alone, with the two known requests") {
  const std::regex encode(R"(encode_frame\()");
  int uses = 0;
  for (const auto& file : sources("recorder")) {
    const std::string text = text_of(file);
    uses += static_cast<int>(std::distance(std::sregex_iterator(text.begin(), text.end(), encode), {}));
    CHECK((text.find("::send(") == std::string::npos || file.filename() == "tcp_link.cpp"));
    CHECK((text.find("encode_frame") == std::string::npos || file.filename() == "tcp_link.cpp"));
  }
  CHECK(uses == 1);
}
