#include "recorder/link/word_order.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>

#include "schema/fields.hpp"
#include "schema/wire/registers.hpp"

namespace tacho::recorder {

namespace {

constexpr std::array kOrders{WordOrder::cdab, WordOrder::abcd, WordOrder::badc, WordOrder::dcba};
constexpr double kLead = 0.25;   // the best must be ahead of every rival by this share of the told values
constexpr double kEnough = 0.5;  // and make at least half of them plausible

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

/// Registers 70-73 as text, bytes of each word swapped when `swapped`; empty when they hold no address.
std::string address_in(std::string_view image, bool swapped) {
  constexpr std::array kIp{field("ip_1"), field("ip_2"), field("ip_3"), field("ip_4")};
  std::string text;
  for (const FieldIndex f : kIp) {
    const std::optional<std::uint16_t> raw = word(image, field_at(f).reg.address);
    if (!raw) {
      return {};
    }
    const unsigned part = swapped ? static_cast<unsigned>(*raw >> 8 | (*raw & 0xFF) << 8) : *raw;
    text += fmt::format("{}{}", text.empty() ? "" : ".", part);
  }
  return text;
}

}  // namespace

WordOrderGuess guess_word_order(std::string_view image, std::string_view peer) {
  WordOrderGuess guess;
  const bool plain = !peer.empty() && address_in(image, false) == peer;
  const bool swapped = !peer.empty() && address_in(image, true) == peer;
  guess.address_matches = plain || swapped;

  std::array<double, kOrders.size()> score{};
  std::string scores;
  for (std::size_t i = 0; i < kOrders.size(); ++i) {
    const bool swaps = kOrders[i] == WordOrder::badc || kOrders[i] == WordOrder::dcba;
    const bool excluded = guess.address_matches && swaps != swapped;
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
  guess.why = fmt::format("plausible values: {}; registers 70-73 {} the robot's address", scores,
                          guess.address_matches ? "hold" : "do not hold");
  if (!guess.sure) {
    guess.why = "not decided by the values, default taken; " + guess.why;
  }
  return guess;
}

}  // namespace tacho::recorder
