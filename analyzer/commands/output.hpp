#pragma once
// Where streamed results go: standard output, or the file of -o.

#include <fstream>
#include <string>
#include <string_view>

namespace tacho::commands {

/// Every write is checked: a full disk or a closed pipe is an Error.
class Output {
 public:
  /// An existing file is replaced. Empty: standard output.
  explicit Output(const std::string& path);
  void write(std::string_view text);
  void close();

 private:
  std::string path_;
  std::ofstream file_;
  void check();
};

}  // namespace tacho::commands
