#pragma once
// Where streamed results go: standard output, or the file of -o.

#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

namespace tacho::commands {

/// Every write is checked: a full disk or a closed pipe is an Error. A file is named PATH.unfinished until close(), so
/// that what stands under its name is complete, also when the program was killed.
class Output {
 public:
  /// An existing file is replaced, by close(). Empty: standard output.
  explicit Output(const std::string& path);
  ~Output();  ///< without close(): removes what was written
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;
  void write(std::string_view text);
  void close();

 private:
  std::string path_;
  std::filesystem::path final_;       ///< path_ without symbolic links
  std::filesystem::path unfinished_;  ///< empty: written in place, as devices and pipes are
  std::ofstream file_;
  void check();
};

}  // namespace tacho::commands
