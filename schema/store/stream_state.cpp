#include "schema/store/stream_state.hpp"

#include <algorithm>

#include "schema/store/schema_sql.hpp"

namespace tacho::store {

void WriterHead::write_head(Connection& connection) const {
  Statement robot(connection, insert_sql("robot", "OR REPLACE"));
  Statement open_session(connection, insert_sql("session", "OR REPLACE"));
  Statement stream_row(connection, insert_sql("stream", "OR REPLACE"));
  Statement coverage(connection, insert_sql("coverage", "OR IGNORE"));
  for (const auto& [id, known] : robots) {
    store::write(robot, known);
  }
  if (session) {
    store::write(open_session, *session);
  }
  for (const auto& [id, state] : streams) {
    store::write(stream_row, state.row);
    StreamCount count;  // of nothing yet, but a kill has to know when the stream was last heard
    count.last_us = state.count.last_us;
    store::write(coverage, {session->id, id.first, id.second}, count);
  }
  for (const auto& [id, last] : earlier) {
    StreamCount count;
    count.last_us = last.t_us;
    store::write(coverage, {last.session, id.first, id.second}, count);
  }
}

RobotId WriterHead::id_of(const std::string& name) const {
  const auto found = std::find_if(robots.begin(), robots.end(), [&](const auto& r) { return r.second.name == name; });
  const RobotId next = robots.empty() ? 1 : robots.rbegin()->first + 1;
  return found != robots.end() ? found->first : std::max(next, new_robots_from);
}

const Robot& WriterHead::learn(RobotId id, const Robot& told) {
  Robot& robot = robots.at(id);
  const auto take = [](std::string& known, const std::string& text) { known = text.empty() ? known : text; };
  take(robot.vehicle_id, told.vehicle_id);
  take(robot.mac, told.mac);
  take(robot.model_md5, told.model_md5);
  take(robot.firmware, told.firmware);
  return robot;
}

}  // namespace tacho::store
