// The maps: one Grid per map with all layers.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "analyzer/analyses/blockage_results.hpp"
#include "analyzer/analyses/cells.hpp"
#include "analyzer/math/shrinkage.hpp"

namespace tacho {
namespace {

constexpr std::int64_t kMostCells = 4'000'000;  // 500 m x 500 m at 0.25 m
constexpr double kApart_m = 100.0;              // of empty room: on a larger map the part beyond is left out

struct Box {
  std::int64_t i0 = 0, i1 = -1, j0 = 0, j1 = -1;
  /// In double: two far corners may not fit.
  [[nodiscard]] double area() const {
    return (static_cast<double>(i1 - i0) + 1.0) * (static_cast<double>(j1 - j0) + 1.0);
  }
  [[nodiscard]] bool holds(std::int64_t i, std::int64_t j) const { return i >= i0 && i <= i1 && j >= j0 && j <= j1; }
};

/// The occupied stretch of one axis in which most of the time was spent; empty room of `kApart_m` separates stretches.
void keep_main_stretch(const std::map<std::int64_t, double>& seconds, double cell_m, std::int64_t& lo,
                       std::int64_t& hi) {
  const auto apart = static_cast<std::int64_t>(kApart_m / cell_m);
  double best = -1.0;
  double sum = 0.0;
  std::int64_t from = seconds.begin()->first;
  for (auto at = seconds.begin(); at != seconds.end(); ++at) {
    sum += at->second;
    const auto next = std::next(at);
    if (next != seconds.end() && next->first - at->first <= apart) {
      continue;
    }
    if (sum > best) {
      best = sum;
      lo = from;
      hi = at->first;
    }
    sum = 0.0;
    from = next != seconds.end() ? next->first : from;
  }
}

Box box_of(const Site& site) {
  Box box;
  std::map<std::int64_t, double> across;
  std::map<std::int64_t, double> along;
  for (const auto& [at, cell] : site.cells) {
    const auto [j, i] = at;
    const bool first = box.i1 < box.i0;
    box = {first ? i : std::min(box.i0, i), first ? i : std::max(box.i1, i), first ? j : std::min(box.j0, j),
           first ? j : std::max(box.j1, j)};
    across[i] += cell.seconds;
    along[j] += cell.seconds;
  }
  if (box.area() > static_cast<double>(kMostCells)) {  // a pose far out, or an obstacle point
    keep_main_stretch(across, site.cell_m, box.i0, box.i1);
    keep_main_stretch(along, site.cell_m, box.j0, box.j1);
  }
  return box;
}

class GridMaker {
 public:
  GridMaker(const Site& site, const Box& box) : site_(site), box_(box) {
    grid_.title = "Blockage on " + site.map;
    grid_.map = site.map;
    grid_.cell_m = site.cell_m;
    grid_.i0 = box.i0;
    grid_.j0 = box.j0;
    grid_.width = static_cast<std::size_t>(box.i1 - box.i0 + 1);
    grid_.height = static_cast<std::size_t>(box.j1 - box.j0 + 1);
  }

  /// NaN where the robot never was, unless something stands there.
  template <class ValueOf>
  void layer(const std::string& name, const std::string& title, const std::string& unit, ValueOf&& value_of) {
    GridLayer layer{name, title, unit, {}};
    layer.value.assign(grid_.width * grid_.height, std::numeric_limits<double>::quiet_NaN());
    for (const auto& [at, cell] : site_.cells) {
      const auto [j, i] = at;
      if (box_.holds(i, j)) {
        layer.value[static_cast<std::size_t>(j - box_.j0) * grid_.width + static_cast<std::size_t>(i - box_.i0)] =
            value_of(cell);
      }
    }
    grid_.layers.push_back(std::move(layer));
  }

  void picture(const std::string& layer) { grid_.pictures.push_back(layer); }
  Grid take(const std::string& name) {
    grid_.name = name;
    return std::move(grid_);
  }

 private:
  const Site& site_;
  Box box_;
  Grid grid_;
};

double nan_unless(bool known, double value) { return known ? value : std::numeric_limits<double>::quiet_NaN(); }

void add_exposure_layers(GridMaker& maker) {
  maker.layer("passes", "Passes", "1", [](const SiteCell& c) { return nan_unless(c.passes > 0, c.passes); });
  maker.layer("metres", "Metres driven", "m", [](const SiteCell& c) { return nan_unless(c.passes > 0, c.metres); });
  maker.layer("seconds", "Time spent", "s", [](const SiteCell& c) { return nan_unless(c.passes > 0, c.seconds); });
  maker.layer("episodes", "Blocked episodes", "1",
              [](const SiteCell& c) { return nan_unless(c.passes > 0 || c.episodes > 0, c.episodes); });
  maker.layer("blocked_s", "Time blocked", "s",
              [](const SiteCell& c) { return nan_unless(c.passes > 0, c.blocked_s); });
  maker.layer("lost_s", "Time lost", "s",
              [](const SiteCell& c) { return nan_unless(c.passes > 0 || c.episodes > 0, c.lost_s); });
  maker.layer("slowed_s", "Time slowed", "s", [](const SiteCell& c) { return nan_unless(c.passes > 0, c.slowed_s); });
}

void add_rate_layers(GridMaker& maker, const Site& site, double min_passes) {
  std::vector<double> k;
  std::vector<double> e;
  for (const auto& [at, cell] : site.cells) {
    if (cell.passes >= min_passes) {
      k.push_back(cell.episodes);
      e.push_back(cell.passes);
    }
  }
  const math::Shrinkage shrink = math::shrinkage(k, e);
  maker.layer("rate", "Episodes per pass", "1/pass",
              [&](const SiteCell& c) { return nan_unless(c.passes >= min_passes, c.episodes / c.passes); });
  maker.layer("rate_per_cell_hour", "Episodes per hour that robots spent in this cell", "1/h", [&](const SiteCell& c) {
    return nan_unless(c.passes >= min_passes && c.seconds > 0, c.episodes / c.seconds * 3'600.0);
  });
  maker.layer("theta", "Episodes per pass, drawn towards the mean of the site", "1/pass",
              [&](const SiteCell& c) { return nan_unless(c.passes >= min_passes, shrink.rate(c.episodes, c.passes)); });
  maker.layer("too_few", fmt::format("fewer than {:g} passes", min_passes), "1", [&](const SiteCell& c) {
    return nan_unless((c.passes > 0 || c.episodes > 0) && c.passes < min_passes, 1.0);
  });
  maker.layer("opacity", "Weight of the cell's own data in theta", "1",
              [&](const SiteCell& c) { return nan_unless(c.passes >= min_passes, shrink.weight(c.passes)); });
}

/// Layers per reason, per class and of obstacle points, only for those that occur.
void add_split_layers(GridMaker& maker, const Site& site) {
  std::set<std::int64_t> reasons;
  std::set<std::size_t> classes;
  bool obstacles = false;
  for (const auto& [at, cell] : site.cells) {
    for (const auto& [reason, sum] : cell.by_reason) {
      reasons.insert(reason);
    }
    for (std::size_t c = 0; c < kEpisodeClasses; ++c) {
      if (cell.lost_by_class[c] > 0.0) {
        classes.insert(c);
      }
    }
    obstacles = obstacles || cell.obstacles > 0.0;
  }
  for (const std::int64_t reason : reasons) {
    std::string name = reason_name(reason);
    std::replace(name.begin(), name.end(), ' ', '_');
    const auto sum_of = [reason](const SiteCell& c) {
      const auto at = c.by_reason.find(reason);
      return at != c.by_reason.end() ? at->second : ReasonSum{};
    };
    maker.layer("episodes_" + name, "Blocked episodes, " + reason_name(reason), "1",
                [&](const SiteCell& c) { return nan_unless(c.passes > 0 || c.episodes > 0, sum_of(c).episodes); });
    maker.layer("lost_s_" + name, "Time lost, " + reason_name(reason), "s",
                [&](const SiteCell& c) { return nan_unless(c.passes > 0 || c.episodes > 0, sum_of(c).lost_s); });
    maker.picture("lost_s_" + name);
  }
  for (const std::size_t cls : classes) {
    const std::string name = episode_class_name(static_cast<EpisodeClass>(cls));
    maker.layer("lost_s_" + name, "Time lost, " + name, "s",
                [&](const SiteCell& c) { return nan_unless(c.passes > 0 || c.episodes > 0, c.lost_by_class[cls]); });
  }
  if (obstacles) {
    maker.layer("obstacle_episodes", "Obstacle points of episodes", "1",
                [](const SiteCell& c) { return nan_unless(c.obstacles > 0, c.obstacles); });
  }
}

}  // namespace

void add_blockage_grids(const BlockageData& data, Section& section) {
  for (std::size_t s = 0; s < data.sites.size(); ++s) {
    const Site& site = data.sites[s];
    if (site.cells.empty()) {
      continue;
    }
    const Box box = box_of(site);
    if (box.area() > static_cast<double>(kMostCells)) {
      section.notes.push_back(fmt::format("{}: no grid: the visited area is too large for one picture", site.map));
      continue;
    }
    double outside = 0.0;
    double episodes_outside = 0.0;
    for (const auto& [at, cell] : site.cells) {
      const bool in = box.holds(at.second, at.first);
      outside += in ? 0.0 : cell.seconds;
      episodes_outside += in ? 0.0 : cell.episodes;
    }
    if (outside > 0.0 || episodes_outside > 0.0) {
      section.notes.push_back(fmt::format("{}: the grid leaves out {} s and {:g} episodes far from everything else",
                                          site.map, cells::short_number(outside), episodes_outside));
    }
    GridMaker maker(site, box);
    maker.picture("lost_s");
    maker.picture("rate");
    maker.picture("episodes");
    add_exposure_layers(maker);
    add_rate_layers(maker, site, data.settings.number("blockage.min_passes"));
    add_split_layers(maker, site);
    section.grids.push_back(maker.take(data.sites.size() == 1 ? "map" : fmt::format("map_{}", s + 1)));
  }
}

}  // namespace tacho
