#pragma once
// What a kill leaves to be done in the newest part, before it is written again.

#include "schema/store/part_head.hpp"
#include "schema/store/part_writer.hpp"

namespace tacho::store {

/// Ends sessions that have no end: their planned count becomes the number after the last poll that left a trace, polls
/// without a trace become gap rows with cause recorder_killed, and the coverage rows count every stored answer.
/// Does nothing, and writes nothing, when the last session ended cleanly. One transaction.
void end_killed_sessions(PartWriter& part, PartHead& head);

}  // namespace tacho::store
