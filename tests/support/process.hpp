#pragma once
// Runs one of our programs as a user would: arguments in, exit code and both outputs back.

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/support/golden.hpp"
#include "tests/support/temp_dir.hpp"

namespace tacho::test {

struct Outcome {
  int code = -1;  ///< exit code, or -signal
  std::string out;
  std::string err;
};

/// A running program. Waits for its end when destroyed.
class Process {
 public:
  /// `program` is a path, or a name relative to the build folder: "recorder/tacho-recorder".
  Process(const std::string& program, const std::vector<std::string>& arguments) {
    const std::string path = (std::filesystem::path(TACHO_BINARY_DIR) / program).string();
    std::vector<char*> argv{const_cast<char*>(path.c_str())};
    for (const std::string& argument : arguments) {
      argv.push_back(const_cast<char*>(argument.c_str()));
    }
    argv.push_back(nullptr);
    const std::string out = (dir_ / "out").string();
    const std::string err = (dir_ / "err").string();
    pid_ = fork();
    if (pid_ < 0) {
      throw std::runtime_error("cannot fork");
    }
    if (pid_ == 0) {
      if (std::freopen(out.c_str(), "wb", stdout) != nullptr && std::freopen(err.c_str(), "wb", stderr) != nullptr) {
        execv(path.c_str(), argv.data());
      }
      _exit(127);
    }
  }
  ~Process() {
    if (pid_ > 0) {
      wait();
    }
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void signal(int number) const { kill(pid_, number); }

  Outcome wait() {
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = -1;
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status), read_file(dir_ / "out"),
            read_file(dir_ / "err")};
  }

 private:
  TempDir dir_;
  pid_t pid_ = -1;
};

inline Outcome run(const std::string& program, const std::vector<std::string>& arguments) {
  return Process(program, arguments).wait();
}

}  // namespace tacho::test
