#include "recorder/identity.hpp"

#include <array>
#include <utility>

namespace tacho::recorder {

namespace {

struct Part {
  std::string Identity::*text;
  FieldIndex field;
  std::string Robot::*row;
  const char* name;
  bool of_one_robot;  // no other robot should have the same
};
constexpr std::array kParts{
    Part{&Identity::vehicle_id, field("vehicle_id"), &Robot::vehicle_id, "", true},
    Part{&Identity::mac, field("mac"), &Robot::mac, "MAC ", true},
    Part{&Identity::model_md5, field("model_md5"), &Robot::model_md5, "model ", false},
};

}  // namespace

bool Identity::differs(const Identity& other) const {
  for (const Part& part : kParts) {
    const std::string& mine = this->*part.text;
    const std::string& theirs = other.*part.text;
    if (!mine.empty() && !theirs.empty() && mine != theirs) {
      return true;
    }
  }
  return false;
}

bool Identity::same(const Identity& other) const {
  for (const Part& part : kParts) {
    if (part.of_one_robot && !(this->*part.text).empty() && this->*part.text == other.*part.text) {
      return !differs(other);
    }
  }
  return false;
}

void Identity::learn(const Identity& other) {
  for (const Part& part : kParts) {
    if (!(other.*part.text).empty()) {
      this->*part.text = other.*part.text;
    }
  }
}

std::string Identity::text() const {
  std::string out;
  for (const Part& part : kParts) {
    if (const std::string& text = this->*part.text; !text.empty()) {
      out += (out.empty() ? "" : ", ") + (part.name + text);
    }
  }
  return out.empty() ? "unknown" : out;
}

Identity identity_of(const Sample& sample) {
  Identity out;
  for (const Part& part : kParts) {
    if (sample.at(part.field).has()) {
      out.*part.text = sample.text(part.field);
    }
  }
  return out;
}

Identity identity_of(const Robot& robot) {
  Identity out;
  for (const Part& part : kParts) {
    out.*part.text = robot.*part.row;
  }
  return out;
}

const FieldSet& identity_fields() {
  static const FieldSet fields = [] {
    FieldSet set;
    for (const Part& part : kParts) {
      set.set(part.field);
    }
    return set;
  }();
  return fields;
}

}  // namespace tacho::recorder
