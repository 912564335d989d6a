#include "analyzer/commands/twins.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace tacho::commands {
namespace {

/// What two robots of the log tell of themselves alike, and in what they differ, in words.
struct Likeness {
  std::string same;
  std::string differ;
  bool same_mac = false;
};

Likeness likeness(const Robot& a, const Robot& b) {
  struct Tells {
    const char* name;
    std::string Robot::*text;
    bool is_its_own;  // robots of one kind share the model
  };
  Likeness out;
  for (const Tells& tells : {Tells{"vehicle_id", &Robot::vehicle_id, true}, Tells{"MAC", &Robot::mac, true},
                             Tells{"model_md5", &Robot::model_md5, false}}) {
    const std::string& one = a.*tells.text;
    const std::string& other = b.*tells.text;
    if (one.empty() || other.empty()) {
      continue;
    }
    if (one != other) {
      out.differ += (out.differ.empty() ? "" : ", ") + std::string(tells.name);
    } else if (tells.is_its_own) {
      out.same += fmt::format("{}{} {}", out.same.empty() ? "" : ", ", tells.name, one);
    }
  }
  out.same_mac = !a.mac.empty() && a.mac == b.mac;
  return out;
}

/// Two rows of the log that may be one robot, or two robots at one address; empty: nothing to say. Nothing is merged: a
/// robot under two names is the user's to put together.
std::string twin_note(const Robot& a, const Robot& b) {
  const Likeness like = likeness(a, b);
  const std::string both = fmt::format("{} and {}", a.name, b.name);
  if (!like.same.empty() && like.differ.empty()) {
    return fmt::format(
        "{} say that they are the same robot ({}): it was probably renamed; its answers stand under both names and are "
        "not put together",
        both, like.same);
  }
  if (like.same_mac) {
    return fmt::format(
        "{} have one MAC ({}) and differ in {}: probably one robot that was changed; its answers stand "
        "under both names and are not put together",
        both, a.mac, like.differ);
  }
  if (a.address.empty() || a.address != b.address) {
    return "";
  }
  return like.differ.empty()
             ? fmt::format(
                   "{} were found at one address ({}), and neither tells who it is: perhaps one robot that was "
                   "renamed; nothing is put together",
                   both, a.address)
             : fmt::format("{} were found at one address ({}) and differ in {}: another robot answered there", both,
                           a.address, like.differ);
}

}  // namespace

std::vector<std::string> twin_notes(const RowSource& log, const std::vector<Robot>& chosen) {
  const auto is_chosen = [&](const Robot& robot) {
    return std::any_of(chosen.begin(), chosen.end(), [&](const Robot& r) { return r.id == robot.id; });
  };
  const std::vector<Robot> robots = log.robots();
  std::vector<std::string> notes;
  for (std::size_t b = 1; b < robots.size(); ++b) {
    std::string found;
    for (std::size_t a = 0; a < b && found.empty(); ++a) {
      found = is_chosen(robots[a]) || is_chosen(robots[b]) ? twin_note(robots[a], robots[b]) : "";
    }
    if (!found.empty()) {
      notes.push_back(std::move(found));
    }
  }
  return notes;
}

}  // namespace tacho::commands
