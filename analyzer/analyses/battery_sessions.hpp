#pragma once
// Charge sessions and failed charges (B4).
//
// A session is open while the robot says `charging` or current flows into the battery: it starts with the flag, or with
// the first row of a run of I > I_th that lasts dwell_s; it ends with the last row of either, once neither has been
// seen for dwell_s. A gap of up to session_gap_min inside a session that goes on behind it is part of it (and the
// session is then not "whole"); a longer one ends it.
//
// CC ends at the last moment at which the current was >= 95 % of its own plateau (0.9 quantile); CV is the time after
// it with voltage within 0.5 % of the session's highest. Failed: `charging`, dock or plug, never a current, longer than
// failed_s, and the battery not full.

#include <array>
#include <string>
#include <vector>

#include "analyzer/analyses/battery_rows.hpp"
#include "analyzer/analyses/battery_states.hpp"

namespace tacho::battery {

struct ChargeSession {
  Micros from_us = 0;
  Micros to_us = 0;
  double soc_start = kNone;
  double soc_end = kNone;
  double ah = 0.0;
  double wh = 0.0;
  double peak_a = kNone;
  double end_a = kNone;
  double current_s = 0.0;     ///< time with I > I_th
  double no_current_s = 0.0;  ///< longest pause of current before the battery was full
  double cc_s = kNone;
  double cv_s = kNone;
  double minutes_to_80 = kNone;
  double gap_s = 0.0;
  bool start_seen = true;  ///< the row before was in the log and not charging
  bool end_seen = true;
  bool current_known = false;
  bool energy_known = false;
  bool flagged = false;  ///< the robot said `charging`
  bool contact = false;  ///< dock or plug was on
  bool tapered = false;  ///< current fell below a tenth of the plateau at highest voltage
  // What was seen around the end:
  bool alarm = false;
  bool emergency = false;
  bool task = false;       ///< a task ran or the robot moved within a minute
  bool unplugged = false;  ///< dock or plug went off
  bool cut_by_gap = false;
  std::string station;
  [[nodiscard]] double seconds() const { return static_cast<double>(to_us - from_us) * 1e-6; }
  [[nodiscard]] bool whole() const { return start_seen && end_seen && gap_s == 0.0; }
  /// The flag or contact for longer than `least_s` and never a current.
  [[nodiscard]] bool failed(double least_s, double full_soc) const;
  /// "full", "emergency", "alarm", "unplugged", "task", "gap", "end of record", "not known"
  [[nodiscard]] std::string end_reason(double full_soc) const;
};

/// Current and voltage of one session at a resolution that halves when it grows long.
class ChargeCurve {
 public:
  void clear();
  void add(double seconds, double charge_a, double voltage_v);
  /// Fills cc_s, cv_s and tapered.
  void split(ChargeSession& session) const;

 private:
  struct Bin {
    double a = 0.0;
    double v = 0.0;
    double n = 0.0;
    double n_v = 0.0;
  };
  static constexpr std::size_t kMost = 720;
  std::vector<Bin> bins_;
  double width_s_ = 5.0;
};

class ChargeSessions {
 public:
  /// `sign`: of the charging current.
  ChargeSessions(int sign, const Config& config) : sign_(sign), config_(config) {}
  void step(const Row& row, const FlowStep& flow, double threshold_a);
  void finish();
  [[nodiscard]] const std::vector<ChargeSession>& all() const { return sessions_; }
  /// Dock or plug without charging and without current: failed charges without a session.
  [[nodiscard]] const std::vector<ChargeSession>& idle_contacts() const { return idle_contacts_; }
  /// Sessions so far, the open one included.
  [[nodiscard]] std::size_t started() const { return sessions_.size() + (open_ ? 1U : 0U) + (ending_ ? 1U : 0U); }

 private:
  int sign_;
  Config config_;
  std::vector<ChargeSession> sessions_;
  std::vector<ChargeSession> idle_contacts_;
  ChargeSession now_;    // open, or a run of current that may become one
  ChargeSession after_;  // ended less than a minute ago
  ChargeSession contact_;
  ChargeCurve curve_;
  bool open_ = false;
  bool run_ = false;  // current without flag, not yet dwell_s long
  bool ending_ = false;
  bool in_contact_ = false;
  bool contact_charged_ = false;  // or its start was not seen: then nothing is said about it
  bool contact_before_ = true;
  double pause_s_ = 0.0;  // without current, so far
  bool any_ = false;
  Micros t_us_ = 0;
  BySign<Moved> since_active_;  // moved after the last active row

  void begin(const Row& row, const FlowStep& flow, bool seen);
  void extend(const Row& row, const FlowStep& flow, double threshold_a);
  void close(bool end_seen, bool by_gap);
  void settle();
  void gap(const Row& row, bool active);
  void watch_end(const Row& row, bool active);
  void watch_contact(const Row& row, double threshold_a);
  void close_contact();
  void pause(const Row& row, double charge_a, double threshold_a, double dt);
};

}  // namespace tacho::battery
