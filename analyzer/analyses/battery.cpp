// Is the battery ageing, how is it used, and what goes wrong with charging? METHODS section B: B1 to B5 and B8.

#include <memory>
#include <utility>

#include "analyzer/analyses/analyses.hpp"
#include "analyzer/analyses/battery_fold.hpp"
#include "analyzer/analyses/battery_tables.hpp"

namespace tacho {
namespace {

constexpr std::string_view kQuestion = "Is the battery ageing, and is it charged and used well?";

class BatteryAnalysis final : public Analysis {
 public:
  explicit BatteryAnalysis(const RobotContext& context) : zone_(context.zone) {
    robots_.push_back(std::make_unique<battery::RobotFold>(context));
  }

  void fold(const Slice& slice) override { robots_.front()->fold(slice); }

  void merge(Analysis& other) override {
    auto& battery = dynamic_cast<BatteryAnalysis&>(other);
    for (std::unique_ptr<battery::RobotFold>& robot : battery.robots_) {
      robots_.push_back(std::move(robot));
    }
  }

  Section finish() override {
    Section section;
    section.name = "battery";
    section.title = "Battery";
    section.question = kQuestion;
    section.notes = {
        "An equivalent full cycle (EFC) is a discharge and a charge of the whole battery, in any number of parts.",
        "Limits of EFC by SoC are hard: rounding, hysteresis, polling and gaps. Limits of charge are 95 %: offset of "
        "the "
        "current sensor, and the difference to the sum over every second sample.",
        "SoC is the robot's own estimate. Ah per SoC follows it and measures no capacity.",
        "Days are those of zone " + zone_ + ".",
    };
    for (const std::unique_ptr<battery::RobotFold>& robot : robots_) {
      robot->finish();
      battery::add_notes(section, *robot);
      battery::add_findings(section, *robot);
      battery::add_series(section, *robot);
    }
    battery::add_tables(section, robots_);
    return section;
  }

 private:
  std::string zone_;
  battery::Robots robots_;
};

std::unique_ptr<Analysis> make(const RobotContext& context) { return std::make_unique<BatteryAnalysis>(context); }

}  // namespace

const AnalysisSpec kBattery{"battery", kQuestion, battery::needs, make, battery::setting_rows};

}  // namespace tacho
