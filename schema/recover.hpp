#pragma once
// Writes what can be read of a log into a new one.

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "schema/survey.hpp"

namespace tacho {

struct Recovery {
  std::uint64_t answers = 0;
  std::uint64_t lost = 0;      ///< planned polls that became gap rows
  std::uint64_t left_out = 0;  ///< rows that have no place in a log: they repeat or go back in order
  /// False: beside answers something may be missing, or was made up, that the damaged log cannot prove (see notes).
  bool whole = true;
  std::vector<ReadProblem> problems;   ///< damage met
  std::vector<ReadProblem> notes;      ///< what was made up or taken on trust where damage was
  std::vector<std::string> different;  ///< what the new log does not give back as it was read; empty = as it should be
};

/// Reads a log as LogReader does, and what it cannot read from the pages of the files (store/scavenge.hpp). Rows and
/// parts keep their numbers; polls that are neither stored nor in a gap row become gap rows of cause damaged. Writes
/// nothing but `folder`; while at work up to twice the size of the damaged parts more. Throws Error when `folder` holds
/// anything or cannot be written, or nothing of a log is found.
Recovery recover(std::span<const std::filesystem::path> logs, const std::filesystem::path& folder);

}  // namespace tacho
