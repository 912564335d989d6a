#include "analyzer/commands/output.hpp"

#include <cerrno>
#include <cstring>

#include "analyzer/commands/common.hpp"
#include "schema/error.hpp"

namespace tacho::commands {

Output::Output(const std::string& path) : path_(path) {
  if (!path_.empty()) {
    errno = 0;
    file_.open(path_, std::ios::binary | std::ios::trunc);
    check();
  }
}

void Output::write(std::string_view text) {
  if (path_.empty()) {
    write_stdout(text);
    return;
  }
  file_.write(text.data(), static_cast<std::streamsize>(text.size()));
  check();
}

void Output::close() {
  if (!path_.empty()) {
    file_.close();
    check();
  }
}

void Output::check() {
  if (!file_) {
    throw Error(path_, errno != 0 ? std::strerror(errno) : "cannot be written",
                "check that the folder exists and the disk has room");
  }
}

}  // namespace tacho::commands
