#pragma once
// Marks: what somebody at another terminal wants to find again in the log.
//
// They travel as datagrams over a socket in the folder of the log, so that whoever may write there may mark, that
// nobody else can, and that nothing is left behind when nobody records. The log folder belongs to one recorder (its
// lock), so a socket that a killed one left is replaced. Owner and group may mark, others not.

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "schema/error.hpp"

namespace tacho::recorder {

struct Mark {
  std::string robot;  ///< empty: all
  std::string text;
};

inline constexpr std::size_t kLongestMark = 2'000;  ///< bytes of the text

/// Takes marks while it lives. One thread.
class MarkSocket {
 public:
  /// Throws Error when the socket cannot be made. `log`: an existing folder that this process records into.
  explicit MarkSocket(const std::filesystem::path& log);
  ~MarkSocket();
  MarkSocket(const MarkSocket&) = delete;
  MarkSocket& operator=(const MarkSocket&) = delete;

  /// The next mark that has arrived, without waiting. What is no mark is dropped.
  std::optional<Mark> next();

 private:
  std::filesystem::path path_;
  int socket_ = -1;
};

/// Hands a mark to whoever records into the log. Throws Error when nobody does, or when it may not.
void send_mark(const std::filesystem::path& log, const Mark& mark);

/// Throws Error when it is empty, too long, or no UTF-8.
void check_mark_text(std::string_view text);

}  // namespace tacho::recorder
