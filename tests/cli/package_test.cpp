// The .deb as a site gets it: made by CPack, unpacked, and what its unit names looked for in it.

#include <algorithm>
#include <sstream>

#include "recorder/config.hpp"
#include "tests/support/catch.hpp"
#include "tests/support/process.hpp"

using namespace tacho;
using test::Outcome;
using test::run;
using test::TempDir;
namespace fs = std::filesystem;

namespace {

bool have(const std::string& program) { return fs::exists("/usr/bin/" + program); }

std::string value_of(const std::string& unit, const std::string& key) {
  std::istringstream lines(unit);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with(key + "=")) {
      return line.substr(key.size() + 1);
    }
  }
  return "";
}

bool has_line(const std::string& text, const std::string& wanted) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (line == wanted) {
      return true;
    }
  }
  return false;
}

}  // namespace

TEST_CASE("the package holds the programs, the unit, its user, and a configuration that is the administrator's") {
  if (!have("cpack") || !have("dpkg-deb") || !have("dpkg-shlibdeps")) {
    WARN("skipped: this host makes no .deb");
    return;
  }
  TempDir dir;
  const Outcome made = run("/usr/bin/cpack", {"--config", TACHO_BINARY_DIR "/CPackConfig.cmake", "-B", dir.path()});
  INFO(made.out << made.err);
  REQUIRE(made.code == 0);
  std::vector<std::string> packages;
  for (const auto& entry : fs::directory_iterator(dir.path())) {
    if (entry.path().extension() == ".deb") {
      packages.push_back(entry.path());
    }
  }
  REQUIRE(packages.size() == 1);
  const fs::path root = dir / "root";
  REQUIRE(run("/usr/bin/dpkg-deb", {"-R", packages[0], root}).code == 0);

  const std::string unit = test::read_file(root / "usr/lib/systemd/system/tacho-recorder.service");
  CHECK(value_of(unit, "ExecStart") == "tacho-recorder run --config /etc/tachograph/site.toml");
  for (const char* program : {"tacho-recorder", "tacho-analyzer", "tacho-sim"}) {
    const Outcome version = run(root / "usr/bin" / program, {"--version"});
    CHECK(version.code == 0);
    CHECK(version.out == std::string(program) + " " TACHO_VERSION "\n");
  }
  CHECK(fs::exists(root / "usr/lib/tachograph/tachograph.so"));
  CHECK(fs::exists(root / "usr/share/doc/tachograph/README.md"));
  const std::string user = "u " + value_of(unit, "User") + " ";
  const std::string users = test::read_file(root / "usr/lib/sysusers.d/tachograph.conf");
  CHECK(users.find("\n" + user) != std::string::npos);
  CHECK(value_of(unit, "User") != "root");
  CHECK(test::read_file(root / "DEBIAN/conffiles") == "/etc/tachograph/site.toml\n");
  const recorder::Config config = recorder::read_config(root / "etc/tachograph/site.toml");
  CHECK(config.log.string().starts_with("/var/lib/" + value_of(unit, "StateDirectory") + "/"));

  const std::string control = test::read_file(root / "DEBIAN/control");
  CHECK(has_line(control, "Package: tachograph"));
  CHECK(has_line(control, "Version: " TACHO_VERSION));
  CHECK(control.find("libsqlite3-0") != std::string::npos);
  for (const char* script : {"postinst", "prerm", "postrm"}) {
    INFO(script);
    CHECK(run("/bin/sh", {"-n", root / "DEBIAN" / script}).code == 0);
    CHECK((fs::status(root / "DEBIAN" / script).permissions() & fs::perms::owner_exec) != fs::perms::none);
  }
}
