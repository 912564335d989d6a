// The places: cells with the highest rates, and how concentrated the lost time is.

#include <algorithm>

#include "analyzer/analyses/blockage_results.hpp"
#include "analyzer/analyses/cells.hpp"
#include "analyzer/math/shrinkage.hpp"

namespace tacho {
namespace {

constexpr std::size_t kTopCells = 20;

struct RankedCell {
  const Site* site = nullptr;
  std::pair<std::int64_t, std::int64_t> at;  // (j, i)
  const SiteCell* cell = nullptr;
  double theta = 0.0;
  double site_mean = 0.0;
  double p = 1.0;
  double q = 1.0;
};

/// Cells with enough passes, each tested against the mean rate of its site.
std::vector<RankedCell> ranked_cells(const Site& site, double min_passes) {
  std::vector<RankedCell> out;
  std::vector<double> k;
  std::vector<double> e;
  for (const auto& [at, cell] : site.cells) {
    if (cell.passes >= min_passes) {
      out.push_back({&site, at, &cell, 0, 0, 1, 1});
      k.push_back(cell.episodes);
      e.push_back(cell.passes);
    }
  }
  const math::Shrinkage shrink = math::shrinkage(k, e);
  std::vector<double> p;
  for (RankedCell& r : out) {
    r.theta = shrink.rate(r.cell->episodes, r.cell->passes);
    r.site_mean = shrink.mean;
    r.p = math::poisson_upper_tail(r.cell->episodes, shrink.mean * r.cell->passes);
    p.push_back(r.p);
  }
  const std::vector<double> q = math::false_discovery_rates(p);
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i].q = q[i];
  }
  return out;
}

DataTable top_cells(const BlockageData& data) {
  DataTable table;
  table.name = "top_cells";
  table.title = "Places where robots get blocked most often per pass";
  table.columns = {{"map", "", "Map"},
                   {"x_m", "m", "Centre of the cell"},
                   {"y_m", "m", "Centre of the cell"},
                   integer_column("passes", "Entries of robots"),
                   integer_column("episodes", "Blocked episodes"),
                   {"rate", "1/pass", "Episodes per pass, Garwood limits", true},
                   {"theta", "1/pass", "The same, drawn towards the site's mean"},
                   {"times_mean", "1", "Rate over the site's mean rate"},
                   {"p_value", "1", "Probability of so many episodes at the site's mean rate (Poisson upper tail)"},
                   {"q_value", "1", "False discovery rate over all tested cells (Benjamini-Hochberg)"},
                   {"lost_s", "s", "Lost time"},
                   {"lost_of_all_lost_pct", "%", "Lost time here over the site's lost time"},
                   integer_column("robots", "Robots that were blocked here"),
                   {"reason", "", "Most frequent reason"}};
  std::vector<RankedCell> all;
  for (const Site& site : data.sites) {
    for (const RankedCell& r : ranked_cells(site, data.settings.number("blockage.min_passes"))) {
      if (r.cell->episodes > 0.0) {
        all.push_back(r);
      }
    }
  }
  std::stable_sort(all.begin(), all.end(), [](const RankedCell& a, const RankedCell& b) {
    return a.theta != b.theta ? a.theta > b.theta : a.cell->lost_s > b.cell->lost_s;
  });
  all.resize(std::min(all.size(), kTopCells));
  for (const RankedCell& r : all) {
    const SiteCell& c = *r.cell;
    const auto reason = std::max_element(c.by_reason.begin(), c.by_reason.end(), [](const auto& a, const auto& b) {
      return a.second.episodes < b.second.episodes;
    });
    table.rows.push_back(
        {r.site->map, (static_cast<double>(r.at.second) + 0.5) * r.site->cell_m,
         (static_cast<double>(r.at.first) + 0.5) * r.site->cell_m, static_cast<std::int64_t>(c.passes),
         static_cast<std::int64_t>(c.episodes), cells::rate(c.episodes, c.passes, 1.0, "1/pass"), r.theta,
         c.episodes / c.passes / r.site_mean, r.p, r.q, c.lost_s,
         r.site->lost_s > 0.0 ? Value(100.0 * c.lost_s / r.site->lost_s) : Value(Missing{"no time lost"}),
         static_cast<std::int64_t>(c.robots.size()), reason_name(reason->first)});
  }
  return table;
}

/// Fewest cells that hold a share of the lost time (Lorenz curve).
DataTable concentration(const BlockageData& data) {
  DataTable table;
  table.name = "concentration";
  table.title = "How concentrated the lost time is";
  table.columns = {{"map", "", "Map"},
                   {"lost_of_all_lost_pct", "%", "This share of the site's lost time"},
                   integer_column("cells", "lies in so many cells"),
                   {"cells_of_visited_pct", "%", "Those cells over the visited cells"},
                   integer_column("visited_cells", "Cells a robot was in")};
  for (const Site& site : data.sites) {
    std::vector<double> lost;
    std::int64_t visited = 0;
    for (const auto& [at, cell] : site.cells) {
      visited += cell.passes > 0.0 ? 1 : 0;
      if (cell.lost_s > 0.0) {
        lost.push_back(cell.lost_s);
      }
    }
    if (lost.empty() || visited == 0) {
      continue;
    }
    std::sort(lost.rbegin(), lost.rend());
    for (const double share : {0.5, 0.8, 0.95}) {
      double sum = 0.0;
      std::int64_t count = 0;
      while (static_cast<std::size_t>(count) < lost.size() && sum < share * site.lost_s) {
        sum += lost[static_cast<std::size_t>(count)];
        ++count;
      }
      table.rows.push_back(
          {site.map, 100.0 * share, count, 100.0 * static_cast<double>(count) / static_cast<double>(visited), visited});
    }
  }
  return table;
}

}  // namespace

void add_blockage_cell_tables(const BlockageData& data, Section& section) {
  section.tables.push_back(top_cells(data));
  section.tables.push_back(concentration(data));
}

}  // namespace tacho
