#include "analyzer/commands/output.hpp"

#include "tests/support/catch.hpp"
#include "tests/support/golden.hpp"
#include "tests/support/temp_dir.hpp"

using namespace tacho;
using commands::Output;
using test::read_file;
using test::TempDir;
namespace fs = std::filesystem;

TEST_CASE("a file has its name only when it is complete") {
  TempDir dir;
  const fs::path file = dir / "ex.csv";
  {
    Output output(file.string());
    output.write("x\r\n");
    CHECK_FALSE(fs::exists(file));
    CHECK(fs::exists(dir / "ex.csv.unfinished"));
    output.close();
    CHECK(read_file(file) == "x\r\n");
    CHECK_FALSE(fs::exists(dir / "ex.csv.unfinished"));
  }
  CHECK(read_file(file) == "x\r\n");
}

TEST_CASE("a file that fails half way leaves the one before it, and nothing beside it") {
  TempDir dir;
  const fs::path file = dir / "ex.csv";
  std::ofstream(file) << "before";
  {
    Output output(file.string());
    output.write("half");
    CHECK(read_file(file) == "before");
  }
  CHECK(read_file(file) == "before");
  CHECK_FALSE(fs::exists(dir / "ex.csv.unfinished"));
}

TEST_CASE("a device is written in place and a symbolic link keeps pointing") {
  TempDir dir;
  fs::create_symlink("/dev/null", dir / "null");
  Output null((dir / "null").string());
  null.write("x");
  null.close();
  CHECK(fs::is_symlink(dir / "null"));
  std::ofstream(dir / "real.csv") << "before";
  fs::create_symlink(dir / "real.csv", dir / "link.csv");
  Output link((dir / "link.csv").string());
  link.write("after");
  link.close();
  CHECK(fs::is_symlink(dir / "link.csv"));
  CHECK(read_file(dir / "real.csv") == "after");
}
