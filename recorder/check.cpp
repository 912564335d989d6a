#include "recorder/check.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <future>
#include <memory>
#include <optional>
#include <system_error>
#include <vector>

#include "recorder/fleet.hpp"
#include "recorder/recorder.hpp"
#include "schema/log.hpp"
#include "schema/store/kept_parts.hpp"
#include "schema/text.hpp"
#include "schema/time.hpp"

namespace tacho::recorder {

namespace {

constexpr int kPolls = 3;  // enough to tell the network's time from the first answer's

std::string period_text(Micros period) {
  return period < 1'000'000 ? fmt::format("at {:g} Hz", 1e6 / static_cast<double>(period))
                            : "every " + duration_text(period);
}

std::string rates_text(const Rates& rates) {
  std::string text = period_text(rates.period_us[0]);
  for (std::size_t i = 1; i < kActivityCount && rates.varies(); ++i) {
    text += fmt::format(", {} when {}", period_text(rates.period_us[i]), kActivityNames[i]);
  }
  return text;
}

std::string text_or(const Sample& sample, FieldIndex f, std::string_view otherwise) {
  return sample.at(f).has() && !sample.text(f).empty() ? std::string(sample.text(f)) : std::string(otherwise);
}

/// The report on one robot, built source by source.
class RobotCheck {
 public:
  explicit RobotCheck(const RobotConfig& robot) : robot_(robot) {
    result_.text =
        fmt::format("{} at {}{}\n", robot.name, robot.address(),
                    robot.settings.period(Source::push) > 0 ? fmt::format(", push {}", robot.push_port) : "");
  }

  CheckResult run() {
    TcpLink status(status_link_options(robot_, hint_));
    for (const Source source : {Source::status, Source::io, Source::pose, Source::ring}) {
      if (robot_.settings.period(source) > 0) {
        ask(status, source, robot_.settings.status.timeout_us, robot_.settings.status.spacing_us);
      } else if (source == Source::io) {
        line(Source::io, io_off_text());
      }
    }
    status.close();
    ModbusLink modbus(modbus_link_options(robot_, hint_));
    for (const Source source : {Source::inputs, Source::registers}) {  // inputs first: they gate some registers
      if (robot_.settings.period(source) > 0) {
        modbus_ = &modbus;
        ask(modbus, source, robot_.settings.modbus.timeout_us, robot_.settings.modbus.spacing_us);
      }
    }
    if (robot_.settings.period(Source::push) > 0) {
      PushLink push(robot_.host, robot_.push_port);
      ask(push, Source::push, std::max(robot_.settings.status.timeout_us, 3 * robot_.settings.period(Source::push)), 0);
    }
    return result_;
  }

 private:
  void line(Source source, const std::string& text) {
    result_.text += fmt::format("  {:<10} {}\n", source_name(source), printable(text));
  }
  void more(const std::string& text) { result_.text += fmt::format("             {}\n", printable(text)); }

  void ask(Link& link, Source source, Micros timeout_us, Micros spacing_us) {
    std::vector<Micros> rtt;
    PollResult last;
    for (int i = 0; i < kPolls; ++i) {
      if (i > 0) {
        HostClock().sleep_until(mono_now_us() + spacing_us);
      }
      PollResult result = link.poll(source, std::chrono::milliseconds(timeout_us / 1000));
      if (!result.ok) {
        ++result_.problems;
        const bool answers_strangely = result.cause == Cause::timeout || result.cause == Cause::closed;
        line(source,
             fmt::format("FAILED ({}): {}{}", cause_name(result.cause), result.detail,
                         answers_strangely ? "; is it the right port? usual are 19204 (status) and 502 (Modbus)" : ""));
        return;
      }
      rtt.push_back(result.t_recv_us - result.t_send_us);
      // The first sweep may be the one that learned what the robot refuses.
      partial_ = i == 0 && result.partial ? result.detail : i == 0 ? std::string() : partial_;
      last = std::move(result);
    }
    std::sort(rtt.begin(), rtt.end());
    const std::string rates = rates_text(robot_.settings.rates(source));
    line(source, source == Source::push
                     ? fmt::format("ok, {} B, expected {} until the robot shows another pace", last.body.size(), rates)
                     : fmt::format("ok, {} B in {:.1f} ms (median of {}), to be asked {}", last.body.size(),
                                   static_cast<double>(rtt[rtt.size() / 2]) / 1e3, kPolls, rates));
    if (!last.give_up.empty()) {
      ++result_.problems;
      more(last.give_up);
    }
    describe(source, std::move(last));
  }

  void describe(Source source, PollResult result) {
    Answer answer;
    answer.meta.source = source;
    answer.body = std::move(result.body);
    WordOrder order = robot_.settings.modbus.word_order.value_or(WordOrder::cdab);
    if (modbus_ != nullptr && modbus_->word_order()) {
      order = modbus_->word_order()->order;
    }
    decoder_.decode(answer, order, FieldSet().set(), true, gates_, sample_);
    if (!sample_.decodable) {
      ++result_.problems;
      more("the answer cannot be decoded; it would be kept as it is, and no analysis could use it");
      return;
    }
    std::string unknown;
    for (const std::string& key : sample_.unknown_keys) {
      unknown += " " + key;
    }
    more(fmt::format("{} fields found, {} unknown keys{}{}", sample_.seen().count(), sample_.unknown_keys.size(),
                     unknown.empty() ? "" : ":", unknown));
    look_for_keys(source, answer.body);
    if (source == Source::status) {
      describe_status();
    } else if (source == Source::registers) {
      describe_registers(order);
    }
    if (!partial_.empty()) {
      more(partial_);
    }
    if (source == Source::registers || source == Source::inputs) {
      more(fmt::format("requests {}", wire::to_text(modbus_->plan(source).ranges())));
    }
  }

  /// A robot leaves out what it does not know without a word.
  void look_for_keys(Source source, const std::string& body) {
    if (source != Source::status && source != Source::ring) {
      return;
    }
    const std::vector<std::string_view> answered = wire::member_keys(body);
    for (const std::string& key : robot_.settings.status.request.keys) {
      if (std::find(answered.begin(), answered.end(), key) == answered.end()) {
        ++result_.problems;
        more(fmt::format("asked for '{}' by `keys`, which the answer does not have", key));
      }
    }
  }

  void describe_status() {
    has_io_ = sample_.at(field("di")).has() || sample_.at(field("do")).has();
    more(fmt::format("vehicle {}, MAC {}, model {}, map {}", text_or(sample_, field("vehicle_id"), "unnamed"),
                     text_or(sample_, field("mac"), "not given"), text_or(sample_, field("model_md5"), "not given"),
                     text_or(sample_, field("current_map"), "not given")));
    if (sample_.at(field("port_19204")).has()) {
      more(fmt::format("clients on the status port, this one included: {} {}", sample_.at(field("port_19204")).integer,
                       text_or(sample_, field("port_19204_ip"), "")));
    }
  }

  void describe_registers(WordOrder order) {
    if (modbus_->word_order()) {
      more(fmt::format("word order {}: {}", word_order_name(order), modbus_->word_order()->why));
    } else {
      more(fmt::format("word order {}: as configured", word_order_name(order)));
    }
    if (modbus_->shift() != 0) {
      more("addresses are sent as documented, not minus one as usual; inputs follow when they are recorded");
    }
    const auto part = [this](FieldIndex f) { return sample_.at(f).integer; };
    if (sample_.at(field("version_major")).has()) {
      more(fmt::format("firmware {}.{}.{}.{}", part(field("version_major")), part(field("version_minor")),
                       part(field("version_patch")), part(field("version_redistribute"))));
    }
  }

  [[nodiscard]] std::string io_off_text() const {
    if (!has_io_) {
      return "off";
    }
    return *has_io_ ? "off; DI and DO come with status" : "off, but status carries no DI and DO; add --period io=2Hz";
  }

  const RobotConfig& robot_;
  CheckResult result_;
  AnswerDecoder decoder_;
  Gates gates_;
  Sample sample_;
  std::string partial_;
  std::optional<bool> has_io_;
  ModbusLink* modbus_ = nullptr;
  std::shared_ptr<StatusHint> hint_ = std::make_shared<StatusHint>();
};

/// Why nothing could be written to the folder, or to `there`, the one in which it would be made; empty when it could.
std::string not_writable(const std::filesystem::path& there) {
  std::error_code ignored;
  if (!std::filesystem::is_directory(there, ignored)) {
    return fmt::format("{} is not a folder; choose another one", there.string());
  }
  if (::faccessat(AT_FDCWD, there.c_str(), W_OK | X_OK, AT_EACCESS) != 0) {
    return fmt::format("{}: {}; let the account that records write there, or choose another folder", there.string(),
                       std::generic_category().message(errno));
  }
  return "";
}

/// Whether the log can be written, its space and what the rules make of it. Nothing is made or removed here.
CheckResult check_log(const Config& config) {
  std::error_code ignored;
  std::filesystem::path there = std::filesystem::absolute(config.log, ignored);
  const bool exists = std::filesystem::exists(there, ignored);
  while (!std::filesystem::exists(there, ignored) && there.has_relative_path()) {
    there = there.parent_path();
  }
  CheckResult result{fmt::format("log {}\n", config.log.string()), 0};
  const auto failed = [&](const std::string& why) {
    ++result.problems;
    result.text += fmt::format("  {:<10} FAILED: {}\n", "", why);
  };
  if (const std::string why = not_writable(there); !why.empty()) {
    failed(why);
    return result;
  }
  const auto parts = exists ? store::read_kept_parts(config.log) : std::vector<store::KeptPart>();
  const store::Forecast forecast = store::forecast(config.retention, parts, store::free_disk_bytes(there));
  result.text += fmt::format("  rules      {}\n  space      {}\n", store::rules_text(config.retention),
                             store::forecast_text(forecast, config.retention));
  const std::uint64_t most = forecast.free_bytes.value_or(0) + forecast.used_bytes;
  if (forecast.free_bytes && most < config.retention.reserve_bytes) {
    failed(
        fmt::format("a reserve of {} cannot be kept: without the log {} would be free; lower `reserve` of [retention]",
                    store::size_text(config.retention.reserve_bytes), store::size_text(most)));
  }
  return result;
}

}  // namespace

CheckResult check_robot(const RobotConfig& robot) {
  // A sample is large: keep the state off the stack of the thread.
  return std::make_unique<RobotCheck>(robot)->run();
}

CheckResult check(const Config& config) {
  std::vector<std::future<CheckResult>> running;
  for (const RobotConfig& robot : config.robots) {
    running.push_back(std::async(std::launch::async, [&robot] { return check_robot(robot); }));
  }
  CheckResult all;
  for (auto& one : running) {
    const CheckResult result = one.get();
    all.text += result.text;
    all.problems += result.problems;
  }
  const CheckResult log = config.log.empty() ? CheckResult{"log none given; `run` needs one\n", 0} : check_log(config);
  all.text += log.text;
  all.problems += log.problems;
  return all;
}

}  // namespace tacho::recorder
