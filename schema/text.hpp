#pragma once
// Small helpers on names and on text of others.

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace tacho {

/// Optimal string alignment distance: insert, delete, replace, swap neighbours; case is ignored.
std::size_t edit_distance(std::string_view a, std::string_view b);

/// The candidate nearest to `name`, or empty when none is near (more than a third of its letters differ, at least 2).
std::string nearest(std::string_view name, std::span<const std::string> candidates);

/// "; did you mean 'x'?" or empty.
std::string did_you_mean(std::string_view name, std::span<const std::string> candidates);

/// Why the first argument of a program is none of its commands, and what was meant; empty for a command or an option.
std::string not_a_command(std::string_view argument, std::span<const std::string> commands);

/// Control characters and marks of writing direction become spaces: what robots and people wrote must neither steer a
/// terminal nor forge a line.
std::string printable(std::string text);

}  // namespace tacho
