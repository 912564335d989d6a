#include "samples/simulator/push_server.hpp"

#include <utility>

#include "schema/wire/frame.hpp"

namespace tacho::sim {

PushServer::PushServer(LiveRobot& robot, const FaultPlan& faults, Listener listener, std::chrono::microseconds period)
    : robot_(robot),
      faults_(faults),
      loop_(
          std::move(listener),
          [this](std::size_t, Script& out) {
            if (auto script = faults_.welcome(Port::push)) {
              out = std::move(*script);
            }
            return ignore_client;
          },
          [this] { return faults_.listens(Port::push); }, {[this] { return push(); }, period}) {}

Script PushServer::push() {
  std::string frame = wire::encode_frame(1, 0, wire::kPush, robot_.push());
  Script script = faults_.answer(Port::push, {{}, frame, previous_, pushes_++});
  previous_ = std::move(frame);
  return script;
}

}  // namespace tacho::sim
