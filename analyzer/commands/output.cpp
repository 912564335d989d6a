#include "analyzer/commands/output.hpp"

#include <cerrno>
#include <cstring>

#include "analyzer/commands/common.hpp"
#include "schema/error.hpp"

namespace tacho::commands {

namespace fs = std::filesystem;

Output::Output(const std::string& path) : path_(path) {
  if (path_.empty()) {
    return;
  }
  std::error_code ec;
  final_ = fs::weakly_canonical(path_, ec);
  if (ec) {
    final_ = path_;
  }
  if (!fs::exists(final_, ec) || fs::is_regular_file(final_, ec)) {
    unfinished_ = final_.string() + ".unfinished";
  }
  errno = 0;
  file_.open(unfinished_.empty() ? final_ : unfinished_, std::ios::binary | std::ios::trunc);
  check();
}

Output::~Output() {
  if (!unfinished_.empty()) {
    file_.close();
    std::error_code ignored;
    fs::remove(unfinished_, ignored);
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
  if (path_.empty()) {
    return;
  }
  file_.close();
  check();
  if (!unfinished_.empty()) {
    std::error_code ec;
    fs::rename(unfinished_, final_, ec);
    if (ec) {
      throw Error(path_, ec.message(), "check that this user may write the folder");
    }
    unfinished_.clear();
  }
}

void Output::check() {
  if (!file_) {
    throw Error(path_, errno != 0 ? std::strerror(errno) : "cannot be written",
                "check that the folder exists and the disk has room");
  }
}

}  // namespace tacho::commands
