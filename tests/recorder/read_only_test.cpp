// Read-only by construction: what could write to a robot does not occur in the recorder's sources.

#include <regex>
#include <sstream>

#include "recorder/link/mbap.hpp"
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

TEST_CASE("no Modbus function but 2 and 4 exists, and libmodbus is not used") {
  using tacho::recorder::mbap::Function;
  std::size_t files = 0;
  for (const auto& file : sources("recorder")) {
    ++files;
    INFO(file);
    CHECK(text_of(file).find("<modbus") == std::string::npos);
  }
  CHECK(files > 20);  // the search found the sources
  const std::string codec = text_of(std::filesystem::path(TACHO_SOURCE_DIR) / "recorder/link/mbap.hpp");
  CHECK(codec.find("enum class Function : std::uint8_t { discrete_inputs = 2, input_registers = 4 };") !=
        std::string::npos);
  for (const Function function : {Function::discrete_inputs, Function::input_registers}) {
    const std::string bytes = tacho::recorder::mbap::encode({1, 1, function, 0, 1});
    CHECK((bytes[7] == 2 || bytes[7] == 4));
  }
}

TEST_CASE("no request number but 1100 and 1013 and no control port occurs, and the push link sends nothing") {
  // Robokit requests that command, navigate or configure are 2000 to 6999; their ports are 19205 to 19210.
  const std::regex forbidden(R"(\b(192(00|05|06|07|08|10)|[2-6]\d{3})\b)");
  const std::regex comment_or_text(R"rx("([^"\\]|\\.)*"|//[^\n]*)rx");
  for (const auto& file : sources("recorder")) {
    const std::string code = std::regex_replace(text_of(file), comment_or_text, "");
    INFO(file);
    std::smatch found;
    const bool any = std::regex_search(code, found, forbidden);
    INFO((any ? found.str() : std::string()));
    CHECK_FALSE(any);
  }
  const std::string push = text_of(std::filesystem::path(TACHO_SOURCE_DIR) / "recorder/link/push_link.cpp");
  CHECK_FALSE(push.empty());
  CHECK_FALSE(std::regex_search(push, std::regex(R"(send\(|encode_frame)")));
  CHECK(tacho::wire::kStatusAll1 == 1100);
  CHECK(tacho::wire::kStatusIo == 1013);
}

TEST_CASE("bytes reach a robot by two calls only: a status frame and a Modbus read") {
  const auto count = [](const std::string& pattern) {
    std::map<std::string, int> found;
    const std::regex expression(pattern);
    for (const auto& file : sources("recorder")) {
      const std::string text = text_of(file);
      const auto hits = std::distance(std::sregex_iterator(text.begin(), text.end(), expression), {});
      if (hits > 0) {
        found[file.filename().string()] = static_cast<int>(hits);
      }
    }
    return found;
  };
  using Found = std::map<std::string, int>;
  CHECK(count(R"((::|\b)(send|sendmsg|write|writev)\(\w*fd_)") == Found{{"socket.cpp", 1}});
  CHECK(count(R"(socket_\.send\(bytes, )") == Found{{"tcp_link.cpp", 1}});
  CHECK(count(R"(socket_\.send\(mbap::encode\(request\), )") == Found{{"modbus_link.cpp", 1}});
  CHECK(count(R"(\.send\()") == Found{{"modbus_link.cpp", 1}, {"tcp_link.cpp", 1}});
  CHECK(count(R"(encode_frame\()") == Found{{"tcp_link.cpp", 1}});
}
