#pragma once
// The parts of a log as files: what each one covers and takes, and removing one.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "schema/store/part.hpp"
#include "schema/store/retention.hpp"

namespace tacho::store {

/// What retention has to know of a part; opens no answer. A damaged part of the log is one, too: what cannot be read of
/// it is not known. Empty for a file that is no part of log `log`, which retention leaves alone; an empty `log` is any.
/// `closed` is what the part says.
std::optional<KeptPart> read_kept_part(const PartFile& file, const std::string& log);

/// All parts of the log in a folder, by number; also while it is recorded. Foreign files are left out. Throws Error
/// when the folder cannot be read.
std::vector<KeptPart> read_kept_parts(const std::filesystem::path& folder);

/// Free for this user on the disk of `folder`; empty when the system does not say.
std::optional<std::uint64_t> free_disk_bytes(const std::filesystem::path& folder);

/// Bytes of a part and of the files that SQLite keeps beside it.
std::uint64_t part_file_bytes(const std::filesystem::path& part);

/// Removes the part, then the files beside it: what a kill in between leaves is removed by remove_unfinished_parts().
/// Throws Error when the part itself stays.
void remove_part(const std::filesystem::path& part);

}  // namespace tacho::store
