#pragma once
// A log that says on standard error how far it has been read, once reading takes longer than a second.

#include <chrono>
#include <memory>
#include <vector>

#include "schema/row_source.hpp"

namespace tacho::commands {

class ProgressLog final : public RowSource {
 public:
  ProgressLog(std::unique_ptr<RowSource> log, std::vector<Robot> robots, Window window);
  ~ProgressLog() override;

  [[nodiscard]] std::vector<Robot> robots() const override { return log_->robots(); }
  [[nodiscard]] std::vector<Session> sessions() const override { return log_->sessions(); }
  [[nodiscard]] std::vector<Stream> streams() const override { return log_->streams(); }
  [[nodiscard]] std::vector<Coverage> coverage() const override { return log_->coverage(); }
  [[nodiscard]] std::vector<UnknownKey> unknown_keys() const override { return log_->unknown_keys(); }
  [[nodiscard]] std::vector<ReadProblem> problems() const override { return log_->problems(); }
  void read(RobotId robot, Window window, const Selection& selection,
            const std::function<void(const Slice&)>& yield) override;
  void read_raw(RobotId robot, Source source, Window window, const std::function<void(const Answer&)>& yield) override;

 private:
  using Clock = std::chrono::steady_clock;
  struct Span {
    RobotId robot = 0;
    std::string name;
    Micros from_us = 0;
    Micros to_us = 0;
  };
  std::unique_ptr<RowSource> log_;
  std::vector<Span> spans_;
  Clock::time_point started_ = Clock::now();
  Clock::time_point shown_at_ = Clock::now();
  bool shown_ = false;

  void show(RobotId robot, Micros t_us);
};

}  // namespace tacho::commands
