#include "recorder/link/word_order.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>

#include "schema/fields.hpp"
#include "schema/wire/registers.hpp"
#include "schema/wire/status_json.hpp"

namespace tacho::recorder {

namespace {

constexpr std::array kOrders{WordOrder::cdab, WordOrder::abcd, WordOrder::badc, WordOrder::dcba};
constexpr double kLead = 0.25;   // the best must be ahead of every rival by this share of the told values
constexpr double kEnough = 0.5;  // and make at least half of them plausible
constexpr std::array kShifts{0, 1, -1};
constexpr int kAgreeing = 3;        // so many values of the status answer must be found in the registers
constexpr double kLeastTold = 2.0;  // smaller values agree by chance

std::uint16_t be16(std::string_view bytes, std::size_t at) {
  return static_cast<std::uint16_t>(static_cast<unsigned char>(bytes[at]) << 8 |
                                    static_cast<unsigned char>(bytes[at + 1]));
}

std::optional<std::uint16_t> word(std::string_view image, std::uint16_t address) {
  while (image.size() >= 4) {
    const std::uint16_t first = be16(image, 0);
    const std::uint16_t count = be16(image, 2);
    const std::size_t bytes = 4 + std::size_t{2} * count;
    if (image.size() < bytes) {
      break;
    }
    if (address >= first && address < first + count) {
      return be16(image, 4 + std::size_t{2} * (address - first));
    }
    image.remove_prefix(bytes);
  }
  return std::nullopt;
}

/// The four parts of an IPv4 address; empty for any other.
std::optional<std::array<unsigned, 4>> parts_of(std::string_view address) {
  in_addr raw{};
  if (::inet_pton(AF_INET, std::string(address).c_str(), &raw) != 1) {
    return std::nullopt;
  }
  const std::uint32_t all = ntohl(raw.s_addr);
  return std::array<unsigned, 4>{all >> 24, all >> 16 & 0xFF, all >> 8 & 0xFF, all & 0xFF};
}

/// Whether registers 70-73 hold `address`, bytes of each word swapped when `swapped`. One of them may be missing: a
/// range that was refused may end there.
bool holds_address(std::string_view image, const std::array<unsigned, 4>& address, bool swapped) {
  constexpr std::array kIp{field("ip_1"), field("ip_2"), field("ip_3"), field("ip_4")};
  int known = 0;
  for (std::size_t i = 0; i < kIp.size(); ++i) {
    const std::optional<std::uint16_t> raw = word(image, field_at(kIp[i]).reg.address);
    const unsigned value = swapped ? static_cast<unsigned>(raw.value_or(0) >> 8 | (raw.value_or(0) & 0xFF) << 8)
                                   : unsigned{raw.value_or(0)};
    if (raw && value != address[i]) {
      return false;
    }
    known += raw ? 1 : 0;
  }
  return known >= 3;
}

/// The image as it would be were every address `shift` larger.
std::string relabelled(std::string_view image, int shift) {
  std::string out;
  while (image.size() >= 4) {
    const int first = be16(image, 0) + shift;
    const std::size_t count = be16(image, 2);
    std::string_view words = image.substr(4, 2 * count);
    image.remove_prefix(std::min(image.size(), 4 + 2 * count));
    const std::size_t lost = first < 1 ? static_cast<std::size_t>(1 - first) : 0;  // below the first address
    if (lost >= count || words.size() < 2 * count) {
      continue;
    }
    const wire::Range range{static_cast<std::uint16_t>(std::max(first, 1)), static_cast<std::uint16_t>(count - lost)};
    wire::append_range(out, range, words.substr(2 * lost));
  }
  return out;
}

/// How many values the registers have in common with a status answer. The high word alone makes a value right to some
/// per mille, and one order read an address off finds it where another order does: `close` values tell them apart.
struct Agreement {
  int same = 0;   // a robot that moves changes some of them in between
  int close = 0;  // of those, by far less than a low word adds
  int compared = 0;
  [[nodiscard]] int score() const { return same + close; }
};

Agreement agreement(const Sample& status, std::string_view image, WordOrder order) {
  Sample registers;
  wire::decode_registers(image, order, {}, FieldSet().set(), registers);
  Agreement out;
  for (FieldIndex f = 0; f < kFieldCount; ++f) {
    const Field& about = field_at(f);
    if (about.kind != Kind::real || !about.reg.present() || about.reg.discrete || !status.at(f).has() ||
        registers.at(f).state == State::absent || std::abs(status.at(f).real) < kLeastTold) {
      continue;
    }
    const double told = std::abs(status.at(f).real);
    const double off = registers.at(f).has() ? std::abs(registers.at(f).real - status.at(f).real) : told;
    ++out.compared;
    out.same += off < 0.1 + 0.02 * told ? 1 : 0;
    out.close += off < 2e-4 * told ? 1 : 0;
  }
  return out;
}

/// Decides order and shift when the status answer does; false when it does not.
bool decide_by_status(const RegisterEvidence& evidence, WordOrderGuess& guess) {
  if (evidence.status.empty()) {
    return false;
  }
  Sample status;
  wire::JsonDecoder().decode(evidence.status, FieldSet().set(), false, status);
  Agreement best;
  int rival = 0;
  for (const int shift : kShifts) {
    const std::string image = relabelled(evidence.image, shift);
    for (const WordOrder order : kOrders) {
      const Agreement now = agreement(status, image, order);
      if (now.score() <= best.score()) {
        rival = std::max(rival, now.score());
        continue;
      }
      rival = best.score();
      best = now;
      guess.order = order;
      guess.shift = shift;
    }
  }
  guess.sure = best.same >= kAgreeing && best.same * 2 >= best.compared && best.score() * 2 >= rival * 3;
  guess.placed = guess.sure;
  guess.why = fmt::format("{} of {} values are those of the status answer", best.same, best.compared);
  return guess.sure;
}

/// Where registers 70-73 hold the robot's address, looked for one address up and down as well.
struct Place {
  int shift = 0;
  bool plain = false;
  bool swapped = false;
  [[nodiscard]] bool found() const { return plain || swapped; }
};

Place place_of_address(const RegisterEvidence& evidence) {
  const std::optional<std::array<unsigned, 4>> address = parts_of(evidence.peer);
  for (const int shift : kShifts) {
    const std::string image = relabelled(evidence.image, shift);
    const Place place{shift, address && holds_address(image, *address, false),
                      address && holds_address(image, *address, true)};
    if (place.found()) {
      return place;
    }
  }
  return {};
}

/// Decides the order by what is plausible.
void decide_by_values(std::string_view image, const Place& place, WordOrderGuess& guess) {
  std::array<double, kOrders.size()> score{};
  std::string scores;
  for (std::size_t i = 0; i < kOrders.size(); ++i) {
    const bool swaps = kOrders[i] == WordOrder::badc || kOrders[i] == WordOrder::dcba;
    const bool excluded = place.found() && swaps != place.swapped;
    score[i] = excluded ? 0.0 : wire::plausibility(image, kOrders[i]);
    scores += fmt::format("{}{} {:.0f} %", scores.empty() ? "" : ", ", word_order_name(kOrders[i]), 100.0 * score[i]);
  }
  const auto best = static_cast<std::size_t>(std::max_element(score.begin(), score.end()) - score.begin());
  double rival = 0.0;
  for (std::size_t i = 0; i < score.size(); ++i) {
    rival = i == best ? rival : std::max(rival, score[i]);
  }
  guess.sure = score[best] >= kEnough && score[best] - rival >= kLead;
  guess.order = guess.sure ? kOrders[best] : WordOrder::cdab;
  guess.why =
      fmt::format("{}plausible values: {}", guess.sure ? "" : "not decided by the values, default taken; ", scores);
}

}  // namespace

WordOrderGuess guess_word_order(const RegisterEvidence& evidence) {
  WordOrderGuess guess;
  const Place place = place_of_address(evidence);
  if (!decide_by_status(evidence, guess)) {
    guess = {};
    guess.shift = place.shift;
    guess.placed = place.found();
    decide_by_values(relabelled(evidence.image, place.shift), place, guess);
  }
  guess.address_matches = place.found() && place.shift == guess.shift;
  guess.why += fmt::format("; registers 70-73 {} the robot's address", guess.address_matches ? "hold" : "do not hold");
  if (guess.shift != 0) {
    guess.why += fmt::format("; this robot's addresses are {} than documented", guess.shift > 0 ? "lower" : "higher");
  }
  return guess;
}

}  // namespace tacho::recorder
