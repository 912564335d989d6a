#pragma once
// Who is recording into a log, found out without touching its lock: a lock that is tried, even for a moment, would
// refuse a recorder that starts in that moment.

#include <filesystem>
#include <string>

namespace tacho::recorder {

/// "process 812 on site-pc", from the lock file, when a process of this computer holds the lock (/proc/locks says so);
/// empty otherwise. A process in another container, or on another computer, is not seen.
std::string log_holder(const std::filesystem::path& log);

}  // namespace tacho::recorder
