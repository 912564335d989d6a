#include "analyzer/analysis.hpp"

#include <algorithm>
#include <array>
#include <iterator>

namespace tacho {
namespace {

constexpr std::size_t index(Source source) { return static_cast<std::size_t>(source); }

/// One analysis at work on one robot, and the sources its own needs chose.
struct Worker {
  std::unique_ptr<Analysis> analysis;
  std::array<bool, kSourceCount> sources{};
};

/// Adds the needs of one analysis to what is read of the robot, and says which sources that took.
std::array<bool, kSourceCount> select(const AnalysisSpec& spec, const RobotContext& context, Selection& selection) {
  std::array<bool, kSourceCount> used{};
  for (const Need& need : spec.needs()) {
    if (const std::optional<Source> source = context.choose(need)) {
      selection.add(*source, need.field);
      used[index(*source)] = true;
    }
  }
  return used;
}

bool any(const Selection& selection) {
  return std::any_of(selection.rows.begin(), selection.rows.end(), [](bool rows) { return rows; });
}

std::vector<Robot> wanted_robots(const RowSource& log, std::span<const RobotId> ids) {
  std::vector<Robot> robots = log.robots();
  if (!ids.empty()) {
    std::erase_if(robots, [&](const Robot& r) { return std::find(ids.begin(), ids.end(), r.id) == ids.end(); });
  }
  std::sort(robots.begin(), robots.end(), [](const Robot& a, const Robot& b) { return a.id < b.id; });
  return robots;
}

/// Shows one analysis the slice, without the sources that only others asked for.
void show(const Slice& slice, Worker& worker) {
  const auto own = [&](const Batch& batch) { return worker.sources[index(batch.source)]; };
  if (std::all_of(slice.batches.begin(), slice.batches.end(), own)) {
    worker.analysis->fold(slice);
    return;
  }
  Slice shown{slice.robot, slice.session, {}, slice.gaps, slice.events, slice.clock};
  std::copy_if(slice.batches.begin(), slice.batches.end(), std::back_inserter(shown.batches), own);
  worker.analysis->fold(shown);
}

std::vector<std::unique_ptr<Analysis>> run_robot(std::span<const AnalysisSpec> specs, RowSource& log,
                                                 const RobotContext& context) {
  Selection selection;
  std::vector<Worker> workers;
  for (const AnalysisSpec& spec : specs) {
    Worker worker;
    worker.sources = select(spec, context, selection);
    worker.analysis = spec.make(context);
    workers.push_back(std::move(worker));
  }
  if (any(selection)) {
    log.read(context.robot.id, context.window, selection, [&](const Slice& slice) {
      for (Worker& worker : workers) {
        show(slice, worker);
      }
    });
  }
  std::vector<std::unique_ptr<Analysis>> done;
  for (Worker& worker : workers) {
    done.push_back(std::move(worker.analysis));
  }
  return done;
}

}  // namespace

const Coverage* RobotContext::find(Source source) const {
  for (const Coverage& c : coverage) {
    if (c.source == source) {
      return &c;
    }
  }
  return nullptr;
}

std::optional<Source> RobotContext::choose(const Need& need) const {
  for (const FieldSet Coverage::*given : {&Coverage::valued, &Coverage::seen}) {
    for (const Source source : need.sources) {
      const Coverage* c = find(source);
      if (c != nullptr && c->stored > 0 && (c->*given).test(need.field) && c->last_us >= window.from_us &&
          c->first_us < window.to_us) {
        return source;
      }
    }
  }
  return std::nullopt;
}

std::vector<Section> run_analyses(std::span<const AnalysisSpec> specs, RowSource& log, std::span<const RobotId> robots,
                                  Window window, const std::string& zone, const Settings& settings) {
  RobotContext context;
  context.window = window;
  context.zone = zone;
  context.settings = &settings;

  std::vector<std::unique_ptr<Analysis>> merged;
  for (const Robot& robot : wanted_robots(log, robots)) {
    context.robot = robot;
    context.coverage.clear();
    for (const Coverage& c : log.coverage()) {
      if (c.robot == robot.id) {
        context.coverage.push_back(c);
      }
    }
    std::vector<std::unique_ptr<Analysis>> one = run_robot(specs, log, context);
    if (merged.empty()) {
      merged = std::move(one);
      continue;
    }
    for (std::size_t i = 0; i < merged.size(); ++i) {
      merged[i]->merge(*one[i]);
    }
  }
  std::vector<Section> sections;
  for (std::size_t i = 0; i < specs.size(); ++i) {
    if (merged.empty()) {  // a log without robots: the analysis itself says what it cannot know
      context.robot = Robot{};
      context.coverage.clear();
      sections.push_back(specs[i].make(context)->finish());
    } else {
      sections.push_back(merged[i]->finish());
    }
  }
  return sections;
}

Section run_analysis(const AnalysisSpec& spec, RowSource& log, std::span<const RobotId> robots, Window window,
                     const std::string& zone, const Settings& settings) {
  return run_analyses({&spec, 1}, log, robots, window, zone, settings).front();
}

}  // namespace tacho
