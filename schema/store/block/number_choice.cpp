// Looking for the style of a column of numbers.

#include <algorithm>
#include <array>
#include <limits>

#include "schema/store/block/number_style.hpp"
#include "schema/store/block/number_text.hpp"

namespace tacho::store {

namespace {

constexpr unsigned kFewDecimals = 9;
constexpr std::size_t kSample = 64;
/// Numbers of so few digits are decimals and nothing else.
constexpr unsigned kFewDigits = 7;

/// What the texts of a column have in common.
struct Survey {
  std::size_t numbers = 0;
  std::array<std::size_t, kMaxDecimals + 2> with_decimals{};  ///< numbers without exponent; the last: more
  unsigned significant = 0;
  unsigned padded_width = 0;
  bool pointed_zero = false;
  // exponents
  bool exponent = false;
  int largest_small = std::numeric_limits<int>::min();  ///< highest point at or left of 0 written with exponent
  int smallest_large = std::numeric_limits<int>::max();
  bool padded_exponent = false;
  bool plus_exponent = false;
  std::size_t whole_with_point = 0;
  std::size_t whole_without_point = 0;

  void add(std::string_view text) {
    if (text == kPointedZero) {
      pointed_zero = true;
      ++numbers;
      return;
    }
    const NumberText n = scan_number(text);
    if (!n.valid) {
      return;
    }
    ++numbers;
    significant = std::max(significant, n.significant);
    padded_width = std::max(padded_width, n.padded ? n.whole_digits : 0U);
    if (n.exponent) {
      add_exponent(n);
      return;
    }
    ++with_decimals[std::min<std::size_t>(n.decimals, kMaxDecimals + 1)];
    whole_with_point += n.decimals == 1 && n.ends_with_zero ? 1 : 0;
    whole_without_point += n.decimals == 0 ? 1 : 0;
  }

 private:
  void add_exponent(const NumberText& n) {
    exponent = true;
    constexpr unsigned kPadded = 2;
    padded_exponent = padded_exponent || (n.exponent_digits == kPadded && n.point > -9 && n.point <= 10);
    if (n.point <= 0) {
      largest_small = std::max(largest_small, n.point);
    } else {
      smallest_large = std::min(smallest_large, n.point);
      plus_exponent = plus_exponent || n.plus;
    }
  }
};

/// Every n-th text, at most kSample.
std::vector<std::string_view> sample_of(std::span<const std::string_view> texts) {
  const std::size_t step = std::max<std::size_t>(texts.size() / kSample, 1);
  std::vector<std::string_view> sample;
  for (std::size_t i = 0; i < texts.size(); i += step) {
    sample.push_back(texts[i]);
  }
  return sample;
}

std::size_t fitting(const NumberStyle& style, std::span<const std::string_view> texts) {
  return static_cast<std::size_t>(std::count_if(
      texts.begin(), texts.end(), [&](std::string_view text) { return number_value(style, text).has_value(); }));
}

/// The first of the candidates that nearly as many texts fit as any other.
struct Choice {
  std::optional<NumberStyle> style;
  std::size_t fits = 0;
};
Choice best_of(std::span<const NumberStyle> candidates, std::span<const std::string_view> texts) {
  Choice best;
  for (const NumberStyle& candidate : candidates) {
    const std::size_t fits = fitting(candidate, texts);
    constexpr std::size_t kPercent = 100;
    constexpr std::size_t kNearly = 102;
    if (fits * kPercent > best.fits * kNearly) {
      best = {candidate, fits};
    }
  }
  return best;
}

Choice decimal_choice(const Survey& survey, std::span<const std::string_view> texts) {
  const auto& counts = survey.with_decimals;
  std::size_t most = 0;   // decimals of the longest fraction
  std::size_t usual = 0;  // the same without the longest 2 %
  std::size_t least = kMaxDecimals + 1;
  const std::size_t total = std::max<std::size_t>(survey.numbers, 1);
  std::size_t upto = 0;
  for (std::size_t d = 0; d < counts.size(); ++d) {
    if (counts[d] == 0) {
      continue;
    }
    constexpr std::size_t kOutliers = 50;
    usual = total - upto > total / kOutliers ? d : usual;
    upto += counts[d];
    most = d;
    least = std::min(least, d);
  }
  const std::size_t decimals = most > kFewDecimals && usual <= kFewDecimals ? usual : most;
  if (decimals > kMaxDecimals) {
    return {};
  }
  NumberStyle style;
  style.decimals = static_cast<std::uint8_t>(decimals);
  style.width = static_cast<std::uint8_t>(std::clamp<unsigned>(survey.padded_width, 1, kMaxDecimals));
  std::vector<NumberStyle> candidates;
  for (const std::size_t min_decimals : {std::min(least, decimals), decimals}) {
    style.min_decimals = static_cast<std::uint8_t>(min_decimals);
    style.zero_with_point = survey.pointed_zero && min_decimals != 1;
    candidates.push_back(style);
  }
  return best_of(candidates, texts);
}

Choice real_choice(const Survey& survey, std::span<const std::string_view> texts) {
  NumberStyle style;
  constexpr int kFar = 60;
  style.fixed_from = static_cast<std::int8_t>(std::max(survey.largest_small, -kFar - 1) + 1);
  style.fixed_to = static_cast<std::int8_t>(std::min(survey.smallest_large, kFar + 1) - 1);
  style.padded_exponent = survey.padded_exponent;
  style.plus_exponent = survey.plus_exponent;
  style.whole_with_point = survey.whole_with_point > survey.whole_without_point;
  style.zero_with_point = survey.pointed_zero && !style.whole_with_point;
  std::vector<NumberStyle> candidates;
  const auto add = [&](NumberKind kind, unsigned digits) {
    style.kind = kind;
    style.digits = static_cast<std::uint8_t>(digits);
    for (const bool shorter : {false, true}) {
      style.fixed_if_shorter = shorter;
      if (!shorter || digits <= NumberStyle::kShortestFloat) {
        candidates.push_back(style);
      }
    }
  };
  constexpr unsigned kFloatDigits = 9;
  constexpr unsigned kDoubleDigits = 17;
  add(NumberKind::real32, NumberStyle::kShortestFloat);
  add(NumberKind::real32, NumberStyle::kShortestDouble);
  if (survey.significant > 1 && survey.significant <= kFloatDigits) {
    add(NumberKind::real32, survey.significant);
  }
  add(NumberKind::real64, NumberStyle::kShortestDouble);
  if (survey.significant > 1 && survey.significant <= kDoubleDigits) {
    add(NumberKind::real64, survey.significant);
  }
  return best_of(candidates, texts);
}

}  // namespace

std::vector<NumberStyle> json_styles(std::span<const std::string_view> texts) {
  Survey survey;
  for (const std::string_view text : texts) {
    survey.add(text);
  }
  constexpr double kMost = 0.75;
  if (static_cast<double>(survey.numbers) < kMost * static_cast<double>(texts.size())) {
    return {};
  }
  const std::vector<std::string_view> sample = sample_of(texts);
  const auto enough = [&](const Choice& choice) {
    return choice.style && static_cast<double>(choice.fits) >= kMost * static_cast<double>(sample.size());
  };
  std::vector<NumberStyle> styles;
  const Choice decimal = decimal_choice(survey, sample);
  const Choice real = survey.significant > kFewDigits || survey.exponent ? real_choice(survey, sample) : Choice();
  // Reals of more digits than a double surely holds are slow to read from decimals.
  constexpr unsigned kSureDigits = 15;
  if (enough(decimal) && (survey.significant <= kSureDigits || !enough(real))) {
    styles.push_back(*decimal.style);
  }
  if (enough(real)) {
    styles.push_back(*real.style);
  }
  return styles;
}

std::vector<NumberStyle> float_styles(std::span<const std::string_view> texts, WordOrder order) {
  const std::vector<std::string_view> sample = sample_of(texts);
  std::vector<NumberStyle> decimals;
  NumberStyle style;
  style.kind = NumberKind::float_decimal;
  style.order = order;
  constexpr std::uint8_t kMostDecimals = 6;
  for (style.decimals = 0; style.decimals <= kMostDecimals; ++style.decimals) {
    decimals.push_back(style);
  }
  std::vector<NumberStyle> styles;
  const Choice decimal = best_of(decimals, sample);
  constexpr std::size_t kMost = 4;  // all but a quarter
  if (decimal.style && decimal.fits >= sample.size() - sample.size() / kMost) {
    styles.push_back(*decimal.style);
  }
  style.kind = NumberKind::float_bits;
  style.decimals = 0;
  styles.push_back(style);
  return styles;
}

}  // namespace tacho::store
