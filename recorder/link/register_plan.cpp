#include "recorder/link/register_plan.hpp"

#include <algorithm>
#include <utility>

#include "schema/fields.hpp"

namespace tacho::recorder {

namespace {

using wire::Range;

constexpr std::uint16_t kMaxCount = 125;  // of one request, by the protocol

std::uint32_t end_of(Range r) { return static_cast<std::uint32_t>(r.first) + r.count; }

Range between(std::uint32_t first, std::uint32_t end) {
  return {static_cast<std::uint16_t>(first), static_cast<std::uint16_t>(end - first)};
}

/// True when a value occupies both address - 1 and address, so that a request must not begin at `address`.
bool inside_value(bool discrete, std::uint32_t address) {
  return std::any_of(kFields.begin(), kFields.end(), [&](const Field& f) {
    return f.reg.present() && f.reg.discrete == discrete && address > f.reg.address &&
           address < f.reg.address + std::uint32_t{f.reg.words()};
  });
}

std::vector<Range> merged(std::vector<Range> ranges) {
  std::sort(ranges.begin(), ranges.end(), [](Range a, Range b) { return a.first < b.first; });
  std::vector<Range> out;
  for (const Range r : ranges) {
    if (!out.empty() && end_of(out.back()) == r.first) {
      out.back() = between(out.back().first, end_of(r));
    } else {
      out.push_back(r);
    }
  }
  return out;
}

void append(std::vector<Range>& to, const std::vector<Range>& from) { to.insert(to.end(), from.begin(), from.end()); }

}  // namespace

RegisterPlan::RegisterPlan(bool discrete) : discrete_(discrete), ranges_(wire::plan_ranges(discrete)) {}

void RegisterPlan::forget() {
  ranges_ = wire::plan_ranges(discrete_);
  learned_ = false;
}

bool RegisterPlan::restore(const std::vector<Range>& ranges, const std::vector<Range>& illegal) {
  std::vector<Range> all = ranges;
  append(all, illegal);
  std::sort(all.begin(), all.end(), [](Range a, Range b) { return a.first < b.first; });
  const bool whole = std::none_of(all.begin(), all.end(), [this](Range r) {
    return r.first == 0 || r.count == 0 || r.count > kMaxCount || inside_value(discrete_, r.first) ||
           inside_value(discrete_, end_of(r));
  });
  const bool apart =
      std::adjacent_find(all.begin(), all.end(), [](Range a, Range b) { return end_of(a) > b.first; }) == all.end();
  const std::vector<Range> runs = wire::documented_runs(discrete_);
  const bool complete = std::all_of(runs.begin(), runs.end(), [&](Range run) {
    std::uint32_t next = run.first;
    for (const Range r : all) {
      next = r.first <= next ? std::max(next, end_of(r)) : next;
    }
    return next >= end_of(run);
  });
  if (ranges.empty() || !whole || !apart || !complete) {
    return false;
  }
  ranges_ = ranges;
  illegal_ = illegal;
  learned_ = true;
  return true;
}

std::vector<Range> RegisterPlan::runs_inside(Range range) const {
  std::vector<Range> out;
  for (const Range run : wire::documented_runs(discrete_)) {
    const std::uint32_t first = std::max<std::uint32_t>(run.first, range.first);
    const std::uint32_t end = std::min(end_of(run), end_of(range));
    if (first < end) {
      out.push_back(between(first, end));
    }
  }
  return out;
}

/// Two halves, or the range itself when it holds a single value.
std::vector<Range> RegisterPlan::split(Range range) const {
  const std::uint32_t middle = range.first + std::uint32_t{range.count} / 2;
  for (std::uint32_t step = 0; step <= range.count; ++step) {
    for (const std::uint32_t cut : {middle + step, middle - std::min(step, middle)}) {
      if (cut > range.first && cut < end_of(range) && !inside_value(discrete_, cut)) {
        return {between(range.first, cut), between(cut, end_of(range))};
      }
    }
  }
  return {range};
}

void RegisterPlan::bisect(Range refused, const Ask& ask, int& extra, Pieces& out) const {
  std::vector<Range> later;  // right halves of refused left halves: not asked yet, perhaps good
  std::vector<Range> parts = split(refused);
  Reply reply = Reply::bad_address;
  std::vector<Range> good;
  while (parts.size() == 2 && extra < kMaxExtraRequests) {
    ++extra;
    reply = ask(parts[0]);
    if (reply == Reply::ok) {
      good.push_back(parts[0]);
      refused = parts[1];
    } else if (reply == Reply::bad_address || reply == Reply::bad_count) {
      later.push_back(parts[1]);
      refused = parts[0];
    } else {
      break;
    }
    parts = split(refused);
  }
  const bool settled = parts.size() == 1;
  if (settled && reply == Reply::ok && extra < kMaxExtraRequests) {
    ++extra;
    reply = ask(refused);  // inferred so far: confirm
  }
  const bool confirmed = settled && (reply == Reply::bad_address || reply == Reply::bad_count);
  if (confirmed) {
    out.illegal.push_back(refused);
    good = merged(std::move(good));
  } else if (settled && reply == Reply::ok) {
    good.push_back(refused);
  } else {
    append(out.unknown, parts);  // apart: one that is never answered can then be left out alone
  }
  append(out.good, good);
  out.stop = reply == Reply::stop;
  for (const Range rest : merged(std::move(later))) {
    if (out.stop || extra >= kMaxExtraRequests) {
      out.unknown.push_back(rest);
    } else {
      ++extra;
      ask_run(rest, ask, extra, out);
    }
  }
}

void RegisterPlan::halve(Range refused, const Ask& ask, int& extra, Pieces& out) const {
  const std::vector<Range> parts = split(refused);
  if (parts.size() == 1) {
    out.illegal.push_back(refused);
    return;
  }
  for (const Range part : parts) {
    if (out.stop || extra >= kMaxExtraRequests) {
      out.unknown.push_back(part);
    } else {
      ++extra;
      ask_run(part, ask, extra, out);
    }
  }
}

Reply RegisterPlan::ask_run(Range run, const Ask& ask, int& extra, Pieces& out) const {
  const Reply reply = ask(run);
  switch (reply) {
    case Reply::ok:
      out.good.push_back(run);
      break;
    case Reply::bad_address:
      if (split(run).size() == 1) {
        out.illegal.push_back(run);
      } else {
        bisect(run, ask, extra, out);
      }
      break;
    case Reply::bad_count:
      halve(run, ask, extra, out);
      break;
    case Reply::failed:
    case Reply::stop:
      out.unknown.push_back(run);
      out.stop = out.stop || reply == Reply::stop;
      break;
  }
  return reply;
}

bool RegisterPlan::spans_gaps(Range range) const {
  const std::vector<Range> runs = runs_inside(range);
  return runs.size() != 1 || !(runs.front() == range);
}

bool RegisterPlan::leave_out(Range range) {
  const auto found = std::find(ranges_.begin(), ranges_.end(), range);
  if (found == ranges_.end()) {
    return false;
  }
  learned_ = true;
  const auto place = ranges_.erase(found);
  if (spans_gaps(range)) {
    const std::vector<Range> runs = runs_inside(range);
    ranges_.insert(place, runs.begin(), runs.end());
    drop_answered();
    return false;
  }
  if (std::find(illegal_.begin(), illegal_.end(), range) == illegal_.end()) {
    illegal_.push_back(range);
  }
  return true;
}

/// What was illegal before forget() and is asked for again from now on is illegal no longer.
void RegisterPlan::drop_answered() {
  std::erase_if(illegal_, [this](Range bad) {
    return std::any_of(ranges_.begin(), ranges_.end(),
                       [bad](Range r) { return r.first < end_of(bad) && bad.first < end_of(r); });
  });
}

/// The range that is asked last waits; so does one of which it is a part.
void RegisterPlan::visit(Range range, const Ask& ask, int& extra, Pieces& out) const {
  if (out.last && range.first <= out.last->first && end_of(*out.last) <= end_of(range)) {
    out.put_off = range;
  } else {
    ask_range(range, ask, extra, out);
  }
}

/// When it spans gaps and is refused, its runs.
void RegisterPlan::ask_range(Range range, const Ask& ask, int& extra, Pieces& out) const {
  if (out.stop) {
    out.unknown.push_back(range);
    return;
  }
  if (!spans_gaps(range)) {
    const Reply reply = ask_run(range, ask, extra, out);
    out.refused = out.refused || reply == Reply::bad_address || reply == Reply::bad_count;
    return;
  }
  const Reply reply = ask(range);
  if (reply != Reply::bad_address && reply != Reply::bad_count) {
    (reply == Reply::ok ? out.good : out.unknown).push_back(range);
    out.stop = reply == Reply::stop;
    return;
  }
  out.refused = true;
  for (const Range run : runs_inside(range)) {
    visit(run, ask, extra, out);
  }
}

std::vector<Range> RegisterPlan::sweep(const Ask& ask, const std::optional<Range>& last) {
  Pieces pieces;
  pieces.last = last;
  int extra = 0;
  for (const Range range : ranges_) {
    visit(range, ask, extra, pieces);
  }
  while (pieces.put_off) {
    const Range range = *std::exchange(pieces.put_off, std::nullopt);
    if (!spans_gaps(range)) {
      pieces.last.reset();
    }
    ask_range(range, ask, extra, pieces);
  }
  return learn(pieces);
}

/// What was refused for good and is not asked again.
std::vector<Range> RegisterPlan::learn(const Pieces& pieces) {
  // A server that refuses everything may just be starting: nothing is learned from it.
  if (!pieces.refused || pieces.good.empty()) {
    if (!pieces.good.empty() && pieces.unknown.empty()) {
      drop_answered();
    }
    return {};
  }
  learned_ = true;
  ranges_ = pieces.good;
  append(ranges_, pieces.unknown);
  std::sort(ranges_.begin(), ranges_.end(), [](Range a, Range b) { return a.first < b.first; });
  drop_answered();
  std::vector<Range> news;
  for (const Range r : pieces.illegal) {
    if (std::find(illegal_.begin(), illegal_.end(), r) == illegal_.end()) {
      illegal_.push_back(r);
      news.push_back(r);
    }
  }
  return news;
}

}  // namespace tacho::recorder
