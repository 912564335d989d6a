#pragma once
// Derives events from decoded answers. Pure: no clock, no I/O. The recorder and the simulator use it while writing, and
// a verifier can run it again over a log and compare.

#include <functional>
#include <memory>

#include "schema/records.hpp"
#include "schema/sample.hpp"

namespace tacho {

/// One robot, one session. Feed the samples of all its sources in arrival order; edges are found per source, so that a
/// slower source never undoes what a faster one said.
class EventMachine {
 public:
  EventMachine();
  ~EventMachine();
  EventMachine(EventMachine&&) noexcept;
  EventMachine& operator=(EventMachine&&) noexcept;

  /// Calls `emit` for each event of this sample, in a fixed order.
  void step(const Sample& sample, const std::function<void(Event)>& emit);

  /// The fields `step` looks at; decode at least these.
  static const FieldSet& fields(Source source);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho
