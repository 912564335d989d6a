#include "recorder/own_rows.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "recorder/link/register_plan.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

Event event_now(SessionId session, EventKind kind) {
  Event event;
  event.session = session;
  event.kind = kind;
  event.t_us = event.t_from_us = wall_now_us();
  return event;
}

}  // namespace

Stream stream_of(const RobotConfig& robot, const StreamPoll& first) {
  Stream stream;
  stream.session = first.session;
  stream.robot = first.robot;
  stream.source = first.source;
  stream.period_us = robot.settings.rates(first.source).fastest();
  stream.word_order = robot.settings.modbus.word_order.value_or(WordOrder::cdab);
  if (first.source == Source::status) {
    stream.request = wire::status_request_body(robot.settings.status.request);
  } else if (first.source == Source::pose) {
    stream.request = wire::pose_request_body();
  } else if (first.source == Source::ring) {
    stream.request = wire::status_request_body(robot.settings.ring_request());
  } else if (source_info(first.source).protocol == Protocol::modbus) {
    stream.request = wire::to_text(RegisterPlan(first.source == Source::inputs).ranges());
  }
  return stream;
}

Event rate_event(const StreamPoll& from, Micros was_us, Micros is_us, const std::string& why) {
  Event event = event_now(from.session, EventKind::rate);
  event.robot = from.robot;
  event.source = from.source;
  event.seq = from.seq;
  event.old_value = rate_text(was_us);
  event.new_value = rate_text(is_us);
  event.detail = why;
  return event;
}

Gap pause_gap(const StreamPoll& next, Micros from_us, const std::string& why) {
  Gap gap;
  gap.robot = next.robot;
  gap.source = next.source;
  gap.session = next.session;
  gap.seq_from = next.seq;
  gap.t_from_us = from_us;
  gap.t_to_us = std::max(from_us, wall_now_us());
  gap.cause = Cause::recorder_off;
  gap.detail = why;
  return gap;
}

Event config_event(SessionId session, const std::string& what_changed, const std::string& text) {
  Event event = event_now(session, EventKind::config_changed);
  event.subject = what_changed;
  event.detail = text;
  return event;
}

Event mark_event(SessionId session, const std::string& text) {
  Event event = event_now(session, EventKind::mark);
  event.detail = text;
  return event;
}

Event identity_event(SessionId session, RobotId robot, const std::string& row) {
  Event event = event_now(session, EventKind::identity_changed);
  event.robot = robot;
  event.detail = fmt::format("another robot answers; it is recorded as '{}'", row);
  return event;
}

}  // namespace tacho::recorder
