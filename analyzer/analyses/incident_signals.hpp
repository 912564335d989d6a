#pragma once
// Follows every field of one robot through a window: curves of numbers, changes of everything else, last known values.
// A change is seen in one answer and was not there in the answer before: it happened in (hull_from, hull_to].

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "analyzer/settings.hpp"
#include "schema/row_source.hpp"

namespace tacho {

struct SignalChange {
  Source source = Source::status;
  std::uint64_t seq = 0;
  Micros hull_from_us = 0;
  Micros hull_to_us = 0;
  std::string what;  ///< field, "DI 3", "error 52201"
  FieldIndex field = kNoField;
  std::string old_value;
  std::string new_value;
  bool alarm = false;
};

/// A number through the window.
struct SignalCurve {
  FieldIndex field = kNoField;
  Source source = Source::status;
  std::vector<Micros> t_us;
  std::vector<double> value;  ///< angles without jumps at +-pi
  double least = 0.0;
  double greatest = 0.0;
  SettingValue material;      ///< what counts as a change; none: half of the greatest value
  double largest_step = 0.0;  ///< signed
  Micros step_from_us = 0;
  Micros step_to_us = 0;
  bool fell = false;

  /// Range over what counts as a change of this quantity (incident.step_m, incident.step_v, ...): 1 and more is
  /// material. Running times only when they fall.
  [[nodiscard]] double materiality() const;
};

struct LastValue {
  Source source = Source::status;
  State state = State::absent;
  std::string text;
  Micros t_us = 0;
};

class SignalTracker {
 public:
  /// Changes and curves from `from_us` on; last values up to `at_us`. Earlier rows only tell what things were before.
  SignalTracker(Micros from_us, Micros at_us, const Settings& settings, std::string_view robot);
  void fold(const Batch& batch);

  /// Changes of fields, inputs, outputs and alarms, from one source per field: the one with the most answers. Fields
  /// that change in more than half of their answers are running values and are left out.
  [[nodiscard]] std::vector<SignalChange> changes() const;
  [[nodiscard]] std::vector<std::string> running_values() const;
  /// One per numeric field, by materiality, greatest first.
  [[nodiscard]] std::vector<const SignalCurve*> curves() const;
  /// Last value at `at_us`, from the freshest source; null when the field was never given.
  [[nodiscard]] const LastValue* last(FieldIndex field) const;
  /// Alarms present in the last answer before `at_us` that could be read: "error 52201 (text)".
  [[nodiscard]] const std::vector<std::string>& alarms_at() const { return alarms_at_; }

 private:
  using Key = std::pair<FieldIndex, Source>;
  struct Discrete {
    bool known = false;
    std::string text;
    Micros t_send_us = 0;
    std::size_t rows = 0;
    std::vector<SignalChange> changes;
  };
  struct Alarm {
    AlarmLevel level = AlarmLevel::fatal;
    std::string text;
    Micros t_send_us = 0;  // of the last answer that showed it
  };
  struct Alarms {
    std::array<std::optional<Micros>, kAlarmLevels> whole_us;  // request of the last answer that told the whole level
    std::map<std::string, Alarm> standing;                     // by name: "error 52201"
  };
  Micros from_us_;
  Micros at_us_;
  std::map<std::string_view, SettingValue> material_;  // by unit
  std::map<Key, SignalCurve> curves_;
  std::map<Key, Discrete> discrete_;
  std::map<Key, LastValue> last_;
  std::map<std::pair<Source, std::string>, std::pair<bool, Micros>> points_;  // status and when it was last seen
  std::map<Source, Alarms> alarms_;
  std::map<Source, std::size_t> rows_;
  std::vector<SignalChange> other_changes_;
  std::vector<std::string> alarms_at_;

  void number(const Batch& batch, const Column& column, std::size_t row);
  void discrete(const Batch& batch, const Column& column, std::size_t row);
  void note_last(const Batch& batch, const Column& column, std::size_t row, const std::string& text);
  void points(const Batch& batch, std::size_t row);
  void alarms(const Batch& batch, std::size_t row);
  void alarm_change(const Batch& batch, std::size_t row, const std::string& name, Micros from_us, std::string now);
  [[nodiscard]] bool best_source(const Key& key) const;
  [[nodiscard]] static bool running(const Discrete& d);
};

/// Value of a cell as text: code names, yes/no, text.
std::string cell_text(const Batch& batch, const Column& column, std::size_t row);

}  // namespace tacho
