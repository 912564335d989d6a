#include "recorder/metrics.hpp"
#include "schema/time.hpp"

#include <fmt/format.h>

#include <cmath>
#include <initializer_list>
#include <utility>
#include <vector>

namespace tacho::recorder {

namespace {

using Labels = std::initializer_list<std::pair<std::string_view, std::string_view>>;

/// Backslash, quote and line feed are the three characters the format knows an escape for.
std::string escaped(std::string_view value) {
  std::string out;
  for (const char c : value) {
    if (c == '\\' || c == '"') {
      out += '\\';
    }
    out += c == '\n' ? std::string("\\n") : std::string(1, c);
  }
  return out;
}

/// Writes the lines of one metric.
class Lines {
 public:
  Lines(std::string& out, std::string_view name) : out_(out), name_(name) {}
  void add(Labels labels, std::uint64_t value) { line("", labels, fmt::format("{}", value)); }
  void add(Labels labels, double value) { line("", labels, number(value)); }
  void add(std::string_view robot, Source source, const Histogram& histogram) {
    std::uint64_t below = 0;
    for (std::size_t i = 0; i < histogram.buckets.size(); ++i) {
      below += histogram.buckets[i];
      const bool last = i == Histogram::kBounds.size();
      bucket(robot, source, last ? "+Inf" : number(to_seconds(Histogram::kBounds[i])), below);
    }
    end_of(robot, source, histogram);
  }
  /// Of no robot.
  void add(const Histogram& histogram) { add({}, Source::status, histogram); }

 private:
  static std::string number(double value) { return std::isnan(value) ? "NaN" : fmt::format("{}", value); }
  void bucket(std::string_view robot, Source source, const std::string& bound, std::uint64_t count) {
    const std::string value = fmt::format("{}", count);
    if (robot.empty()) {
      line("_bucket", {{"le", bound}}, value);
    } else {
      line("_bucket", {{"robot", robot}, {"source", source_name(source)}, {"le", bound}}, value);
    }
  }
  void end_of(std::string_view robot, Source source, const Histogram& histogram) {
    for (const auto& [suffix, value] : {std::pair{"_sum", number(to_seconds(histogram.sum_us))},
                                        std::pair{"_count", fmt::format("{}", histogram.count)}}) {
      if (robot.empty()) {
        line(suffix, {}, value);
      } else {
        line(suffix, {{"robot", robot}, {"source", source_name(source)}}, value);
      }
    }
  }
  void line(std::string_view suffix, Labels labels, const std::string& value) {
    out_ += name_;
    out_ += suffix;
    char open = '{';
    for (const auto& [label, text] : labels) {
      out_ += fmt::format("{}{}=\"{}\"", open, label, escaped(text));
      open = ',';
    }
    out_ += fmt::format("{}{}\n", open == ',' ? "} " : " ", value);
  }
  std::string& out_;
  std::string_view name_;
};

template <class Value>
void per_stream(const Snapshot& s, Lines& out, const Value& value) {
  for (const StreamNow& stream : s.streams) {
    out.add({{"robot", stream.robot}, {"source", source_name(stream.source)}}, value(stream));
  }
}

void missed(const Snapshot& s, Lines& out) {
  for (const StreamNow& stream : s.streams) {
    for (std::size_t c = 0; c < kCauseCount; ++c) {
      if (stream.missed[c] > 0) {
        const std::string_view cause = cause_name(static_cast<Cause>(c));
        out.add({{"robot", stream.robot}, {"source", source_name(stream.source)}, {"cause", cause}}, stream.missed[c]);
      }
    }
  }
}

void aged_out(const Snapshot& s, Lines& out) {
  for (const StreamNow& stream : s.streams) {
    if (stream.source == Source::ring) {
      out.add({{"robot", stream.robot}}, stream.aged_out);
    }
  }
}

void last_answer(const Snapshot& s, Lines& out) {
  for (const StreamNow& stream : s.streams) {
    if (stream.last_answer_us > 0) {
      out.add({{"robot", stream.robot}, {"source", source_name(stream.source)}}, to_seconds(stream.last_answer_us));
    }
  }
}

void round_trip(const Snapshot& s, Lines& out) {
  for (const StreamNow& stream : s.streams) {
    out.add(stream.robot, stream.source, stream.round_trip);
  }
}

void link_up(const Snapshot& s, Lines& out) {
  for (const LinkNow& link : s.links) {
    std::string protocol(protocol_name(link.protocol));
    std::replace(protocol.begin(), protocol.end(), ' ', '_');
    out.add({{"robot", link.robot}, {"protocol", protocol}}, std::uint64_t{link.up ? 1U : 0U});
  }
}

void clock_offset(const Snapshot& s, Lines& out) {
  for (const auto& [robot, offset_us] : s.clock_offset_us) {
    out.add({{"robot", robot}}, to_seconds(offset_us));
  }
}

template <class Value>
void optional(Lines& out, const Value& value) {
  if (value) {
    out.add({}, *value);
  }
}

struct Metric {
  MetricName about;
  void (*collect)(const Snapshot&, Lines&);
};

// clang-format off
constexpr std::array kMetrics{
    Metric{{"tachograph_build_info", "gauge", "Version of the recorder; the value is always 1"},
           [](const Snapshot&, Lines& out) { out.add({{"version", TACHO_VERSION}}, std::uint64_t{1}); }},
    Metric{{"tachograph_session_start_time_seconds", "gauge", "When this recording began, as Unix time"},
           [](const Snapshot& s, Lines& out) { out.add({}, to_seconds(s.since_us)); }},
    Metric{{"tachograph_polls_planned_total", "counter", "Polls that were due"},
           [](const Snapshot& s, Lines& out) { per_stream(s, out, [](const StreamNow& n) { return n.planned; }); }},
    Metric{{"tachograph_polls_stored_total", "counter", "Polls whose answer is committed to the log"},
           [](const Snapshot& s, Lines& out) { per_stream(s, out, [](const StreamNow& n) { return n.stored; }); }},
    Metric{{"tachograph_polls_partial_total", "counter", "Stored polls of which some register ranges are missing"},
           [](const Snapshot& s, Lines& out) { per_stream(s, out, [](const StreamNow& n) { return n.partial; }); }},
    Metric{{"tachograph_polls_missed_total", "counter", "Polls without an answer by cause; only causes that occurred"},
           missed},
    Metric{{"tachograph_ring_aged_out_total", "counter", "Polls of the ring that were not written: nothing happened"},
           aged_out},
    Metric{{"tachograph_ring_bytes", "gauge", "Memory that the rings hold"},
           [](const Snapshot& s, Lines& out) { out.add({}, std::uint64_t{s.ring_bytes}); }},
    Metric{{"tachograph_poll_period_seconds", "gauge", "How often the source is asked; 0 when it no longer is"},
           [](const Snapshot& s, Lines& out) {
             per_stream(s, out, [](const StreamNow& n) { return to_seconds(n.period_us); });
           }},
    Metric{{"tachograph_last_answer_time_seconds", "gauge", "When the newest answer arrived, as Unix time"},
           last_answer},
    Metric{{"tachograph_round_trip_seconds", "histogram", "From sending a request to the last byte of its answer"},
           round_trip},
    Metric{{"tachograph_link_up", "gauge", "1 while the connection to the robot is up"}, link_up},
    Metric{{"tachograph_robot_clock_offset_seconds", "gauge", "Clock of the robot minus clock of this computer"},
           clock_offset},
    Metric{{"tachograph_queue_items", "gauge", "Answers and other rows waiting for the writer"},
           [](const Snapshot& s, Lines& out) { out.add({}, std::uint64_t{s.queue_items}); }},
    Metric{{"tachograph_queue_bytes", "gauge", "Bytes of the answers that wait for the writer"},
           [](const Snapshot& s, Lines& out) { out.add({}, std::uint64_t{s.queue_bytes}); }},
    Metric{{"tachograph_commit_seconds", "histogram", "How long a commit takes"},
           [](const Snapshot& s, Lines& out) { out.add(s.commits); }},
    Metric{{"tachograph_answer_bytes_total", "counter", "Bytes of the stored answers as the robots sent them"},
           [](const Snapshot& s, Lines& out) { out.add({}, s.writer.body_bytes); }},
    Metric{{"tachograph_written_bytes_total", "counter", "Bytes of the stored answers as first written, compressed"},
           [](const Snapshot& s, Lines& out) { out.add({}, s.writer.stored_bytes); }},
    Metric{{"tachograph_parts_total", "counter", "Part files this recording has written to"},
           [](const Snapshot& s, Lines& out) { out.add({}, s.writer.parts); }},
    Metric{{"tachograph_log_bytes", "gauge", "Size of the log, looked at every ten minutes"},
           [](const Snapshot& s, Lines& out) { out.add({}, s.forecast.used_bytes); }},
    Metric{{"tachograph_disk_free_bytes", "gauge", "Free on the disk of the log, looked at every ten minutes"},
           [](const Snapshot& s, Lines& out) { optional(out, s.forecast.free_bytes); }},
    Metric{{"tachograph_log_bytes_per_day", "gauge", "How fast the log grows; absent in the first hour"},
           [](const Snapshot& s, Lines& out) { optional(out, s.forecast.bytes_per_day); }},
    Metric{{"tachograph_log_days_left", "gauge", "Until the disk or a limit says stop; absent when unknown or never"},
           [](const Snapshot& s, Lines& out) { optional(out, s.forecast.days_left); }},
};
// clang-format on

}  // namespace

std::string metrics_text(const Snapshot& snapshot) {
  std::string out;
  for (const Metric& metric : kMetrics) {
    out += fmt::format("# HELP {0} {1}\n# TYPE {0} {2}\n", metric.about.name, metric.about.help, metric.about.type);
    Lines lines(out, metric.about.name);
    metric.collect(snapshot, lines);
  }
  return out;
}

std::span<const MetricName> metric_names() {
  static constexpr auto kNames = [] {
    std::array<MetricName, kMetrics.size()> names{};
    for (std::size_t i = 0; i < names.size(); ++i) {
      names[i] = kMetrics[i].about;
    }
    return names;
  }();
  return kNames;
}

}  // namespace tacho::recorder
