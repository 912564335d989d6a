#pragma once
// Writes what can be read of a log into a new one.

#include <filesystem>
#include <string>
#include <vector>

#include "schema/survey.hpp"

namespace tacho {

struct Recovery {
  std::uint64_t answers = 0;
  std::uint64_t lost = 0;              ///< planned polls that became gap rows
  std::uint64_t left_out = 0;          ///< rows that have no place in a log: they repeat or go back in order
  std::vector<std::string> different;  ///< what the new log does not give back as it was read; empty = as it should be
};

/// `found` is the survey of `log`. Rows keep their numbers; polls in `found`'s holes become gap rows of cause disk, as
/// the words of which say. Throws Error when `folder` holds anything or cannot be written.
Recovery recover(store::LogReader& log, const Survey& found, const std::filesystem::path& folder);

}  // namespace tacho
