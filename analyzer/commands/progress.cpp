#include "analyzer/commands/progress.hpp"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "analyzer/report/text.hpp"

namespace tacho::commands {
namespace {

using namespace std::chrono_literals;
constexpr const char* kEraseLine = "\r\x1b[K";

}  // namespace

ProgressLog::ProgressLog(std::unique_ptr<RowSource> log, std::vector<Robot> robots, Window window)
    : log_(std::move(log)) {
  for (const Robot& robot : robots) {
    Span span{robot.id, robot.name, 0, 0};
    for (const Coverage& c : log_->coverage()) {
      if (c.robot == robot.id && c.stored > 0) {
        span.from_us = span.to_us == 0 ? c.first_us : std::min(span.from_us, c.first_us);
        span.to_us = std::max(span.to_us, c.last_us);
      }
    }
    span.from_us = std::max(span.from_us, window.from_us);
    span.to_us = std::min(span.to_us, window.to_us);
    spans_.push_back(std::move(span));
  }
}

ProgressLog::~ProgressLog() {
  if (shown_) {
    std::fputs(kEraseLine, stderr);
  }
}

void ProgressLog::show(RobotId robot, Micros t_us) {
  const Clock::time_point now = Clock::now();
  if (now - started_ < 1s || (shown_ && now - shown_at_ < 200ms)) {
    return;
  }
  const auto span = std::find_if(spans_.begin(), spans_.end(), [&](const Span& s) { return s.robot == robot; });
  if (span == spans_.end() || span->to_us <= span->from_us) {
    return;
  }
  const double share = static_cast<double>(t_us - span->from_us) / static_cast<double>(span->to_us - span->from_us);
  std::fprintf(stderr, "%sreading %s (robot %td of %zu): %d %%", kEraseLine, report::one_line(span->name).c_str(),
               span - spans_.begin() + 1, spans_.size(), static_cast<int>(100.0 * std::clamp(share, 0.0, 1.0)));
  std::fflush(stderr);
  shown_at_ = now;
  shown_ = true;
}

void ProgressLog::read(RobotId robot, Window window, const Selection& selection,
                       const std::function<void(const Slice&)>& yield) {
  log_->read(robot, window, selection, [&](const Slice& slice) {
    yield(slice);
    for (const Batch& batch : slice.batches) {
      if (batch.rows() > 0) {
        show(robot, batch.t_recv_us.back());
      }
    }
  });
}

void ProgressLog::read_raw(RobotId robot, Source source, Window window,
                           const std::function<void(const Answer&)>& yield) {
  log_->read_raw(robot, source, window, [&](const Answer& answer) {
    yield(answer);
    show(robot, answer.meta.t_recv_us);
  });
}

}  // namespace tacho::commands
