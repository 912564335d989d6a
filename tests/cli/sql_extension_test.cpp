// tachograph.so inside programs that are not ours: python3 and the sqlite3 shell of the system.

#include <sys/stat.h>

#include "schema/store/sql/sql_session.hpp"
#include "tests/cli/analyze_fixture.hpp"

using namespace tacho;
using namespace tacho::test;
namespace fs = std::filesystem;

namespace {

constexpr const char* kPython = "/usr/bin/python3";
constexpr const char* kShell = "/usr/bin/sqlite3";

/// Runs a program as it is on this system, with the sanitizer it needs to load our code.
Outcome run_foreign(std::vector<std::string> words, const std::vector<std::string>& before = {}) {
  std::vector<std::string> all = before;
  all.insert(all.end(), {"/usr/bin/env", "ASAN_OPTIONS=detect_leaks=0"});
  if (const std::string preload = TACHO_PRELOAD; !preload.empty()) {
    all.push_back("LD_PRELOAD=" + preload);
  }
  all.insert(all.end(), words.begin(), words.end());
  return run(all.front(), {all.begin() + 1, all.end()});
}

bool can_load_extensions() {
  if (std::string(TACHO_SANITIZE).find("thread") != std::string::npos) {
    WARN("skipped: a program without TSan cannot load code with it");
    return false;
  }
  if (!fs::exists(kPython) ||
      run(kPython, {"-c", "import sqlite3; sqlite3.connect(':memory:').enable_load_extension(True)"}).code != 0) {
    WARN("skipped: no python3 here that loads extensions of SQLite");
    return false;
  }
  return true;
}

/// The extension and a log of one closed part, in folders that everybody may read and nobody write.
struct Site {
  TempDir dir;
  std::string extension = (dir / "tachograph").string();
  fs::path log = dir / "log";
  fs::path part = log / "part-000001.db";

  Site() {
    fs::copy(fs::path(TACHO_BINARY_DIR) / "schema" / "tachograph.so", extension + ".so");
    write_short_log(log, 600);
    chmod(dir.path().c_str(), 0755);
    chmod(part.c_str(), 0444);
    chmod(log.c_str(), 0555);
  }
  ~Site() { chmod(log.c_str(), 0755); }
  Site(const Site&) = delete;
  Site& operator=(const Site&) = delete;

  [[nodiscard]] std::string python(const std::string& database, const std::string& work) const {
    return "import sqlite3\ndb = sqlite3.connect('" + database +
           "', uri=True)\ndb.enable_load_extension(True)\ndb.load_extension('" + extension + "')\n" + work + "\n";
  }
};

const Site& site() {
  static const Site kSite;
  return kSite;
}

/// "600|0.89|12345" as both programs print it.
std::string expected() {
  const std::vector<fs::path> paths{site().log};
  const auto log = open_log(paths);
  store::sql::SqlSession session(*log);
  std::string out;
  session.run(
      "select count(*) || '|' || round(avg(battery_level), 6) || '|' || sum(seq) || '|' || max(time) from status",
      [](const std::vector<std::string>&) {},
      [&](std::span<const store::sql::SqlValue> row) { out = std::get<std::string>(row[0]); });
  return out;
}

const std::string kFigures =
    "select count(*) || '|' || round(avg(battery_level), 6) || '|' || sum(seq) || '|' || max(time) from ";

}  // namespace

TEST_CASE("python3 loads the extension into a closed part and has its tables") {
  if (!can_load_extensions()) {
    return;
  }
  const std::string database = "file:" + site().part.string() + "?mode=ro";
  const Outcome outcome = run_foreign(
      {kPython, "-c",
       site().python(database, "print(db.execute(\"\"\"" + kFigures +
                                   "status\"\"\").fetchone()[0])\nprint(db.execute('select count(*) from event e join "
                                   "status s on s.robot_id = e.robot and s.seq = e.seq where e.kind = "
                                   "\\'station\\'').fetchone()[0] > 0)\ndb.close()")});
  INFO(outcome.err);
  CHECK(outcome.code == 0);
  CHECK(outcome.out == expected() + "\nTrue\n");
}

TEST_CASE("another user reads a closed part in a folder that is read only") {
  if (!can_load_extensions()) {
    return;
  }
  if (geteuid() != 0 || !fs::exists("/usr/bin/setpriv")) {
    WARN("skipped: only root can become another user");
    return;
  }
  const std::vector<std::string> nobody{"/usr/bin/setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"};
  for (const std::string& database : {site().part.string(), "file:" + site().part.string() + "?mode=ro"}) {
    const Outcome outcome = run_foreign(
        {kPython, "-c", site().python(database, "print(db.execute(\"\"\"" + kFigures + "status\"\"\").fetchone()[0])")},
        nobody);
    INFO(database << ": " << outcome.err);
    CHECK(outcome.code == 0);
    CHECK(outcome.out == expected() + "\n");
  }
}

TEST_CASE("a folder is a virtual table, and what is wrong is said in words") {
  if (!can_load_extensions()) {
    return;
  }
  const std::string work =
      "def attempt(sql):\n    try:\n        print(db.execute(sql).fetchone()[0])\n    except "
      "sqlite3.Error as error:\n        print(error)\n"
      "db.execute(\"create virtual table temp.s using tacho_status('" +
      site().log.string() +
      "')\")\n"
      "db.execute(\"create virtual table temp.e using tacho_event('" +
      site().log.string() +
      "')\")\n"
      "attempt(\"\"\"" +
      kFigures +
      "s\"\"\")\n"
      "attempt('select count(*) > 0 from e')\n"
      "attempt('delete from s')\n"
      "attempt('create virtual table temp.x using tacho_status')\n"
      "attempt(\"create virtual table temp.n using tacho_status('/nowhere/at/all')\")\n"
      "other = sqlite3.connect(':memory:'); other.enable_load_extension(True)\n"
      "other.load_extension('" +
      site().extension + "'); other.close(); db.close()";
  const Outcome outcome = run_foreign({kPython, "-c", site().python(":memory:", work)});
  INFO(outcome.out << outcome.err);
  CHECK(outcome.code == 0);
  CHECK(outcome.out.rfind(expected() + "\n1\ntable s may not be modified\n", 0) == 0);
  CHECK(outcome.out.find("which log should it read?") != std::string::npos);
  CHECK(outcome.out.find("/nowhere/at/all: does not exist") != std::string::npos);
}

TEST_CASE("the sqlite3 shell loads the extension into a part") {
  if (!can_load_extensions()) {
    return;
  }
  if (!fs::exists(kShell)) {
    WARN("skipped: no sqlite3 shell here");
    return;
  }
  const Outcome outcome = run_foreign({kShell, site().part.string(), ".load " + site().extension, kFigures + "status",
                                       "select count(*) > 0 from event"});
  INFO(outcome.err);
  CHECK(outcome.code == 0);
  CHECK(outcome.out == expected() + "\n1\n");
}
