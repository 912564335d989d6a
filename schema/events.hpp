#pragma once
// Derives events from decoded answers. Pure: no clock, no I/O. The recorder and the simulator use it while writing, and
// a verifier can run it again over a log and compare.
//
// Time: an edge lies in (t_from_us, t_us] = (request of the last answer that showed the old value, receipt of the
// answer that shows the new one]; a gap in between is part of it. Whatever is seen without such an earlier answer has
// t_from_us == t_us.
//
// Values, as text: flags "true" / "false", codes by name ("running", or the number when the list has no name for it),
// texts as they are. The first answer of a session sets the state silently; only alarms that stand already are raised,
// with t_from_us == t_us and an empty old_value.
//
// Absent, null, unreadable and not supplied change nothing: a missing alarm array does not clear its alarms.
//
// Alarms: key (level, code), subject "error 52201", values are the `times` counter (1 when the robot gives none, 0
// while the alarm is absent), detail is the description. `times` growing is a repetition; `times` falling, or another
// stamp with the same `times`, means cleared and raised again between two answers. Elements with the same key are one
// alarm with the largest `times`. An array with elements that could not be read (Sample::alarms_incomplete) raises and
// repeats alarms but clears none, and does not prove that an alarm raised later was absent: t_from_us is then the
// request of the last whole array.
//
// Pose jumps: the pose moved by more than 0.25 m (or turned by more than 0.25 rad) beyond what the larger of the two
// speeds told and 1.5 m/s2 (3 rad/s2) on top could have done in the time, which is at most 5 s; on the same map. Values
// are "x y angle", m and rad. Coarser than the jumps of the odometry analysis, which needs more than two answers.
//
// Answers of `ring` make no events: they are written late, and other sources have told the same.
//
// Unknown keys: one event per source and key, at most 200 keys per source; subject is the key.
//
// Digital points: subject "DI 3" / "DO 3". The same point may be told by `io`, `inputs` and `status`; an edge is
// reported once, from the first of these three that has told the point within the last 3 s. All other edges are found
// per source: a consumer that counts takes one source.

#include <functional>
#include <memory>

#include "schema/records.hpp"
#include "schema/sample.hpp"

namespace tacho {

/// What EventMachine makes. False: told by the links, the scheduler, the clock or a person.
bool derived_from_answers(EventKind kind);

/// One robot, one session. Feed the samples of all its sources in arrival order; edges are found per source, so that a
/// slower source never undoes what a faster one said.
class EventMachine {
 public:
  EventMachine();
  ~EventMachine();
  EventMachine(EventMachine&&) noexcept;
  EventMachine& operator=(EventMachine&&) noexcept;

  /// Calls `emit` for each event of this sample, in a fixed order: decodability, unknown keys, reboot, states in the
  /// order of the table, pose jump, alarms by level and code, points.
  void step(const Sample& sample, const std::function<void(Event)>& emit);

  /// The fields `step` looks at; decode at least these.
  static const FieldSet& fields(Source source);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho
