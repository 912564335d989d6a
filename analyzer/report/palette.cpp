#include "analyzer/report/palette.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace tacho::report {

Colour viridis(double share) {
  static constexpr std::array<Colour, 10> kStops = {{{0x44, 0x01, 0x54},
                                                     {0x48, 0x28, 0x78},
                                                     {0x3E, 0x49, 0x89},
                                                     {0x31, 0x68, 0x8E},
                                                     {0x26, 0x82, 0x8E},
                                                     {0x1F, 0x9E, 0x89},
                                                     {0x35, 0xB7, 0x79},
                                                     {0x6E, 0xCE, 0x58},
                                                     {0xB5, 0xDE, 0x2B},
                                                     {0xFD, 0xE7, 0x25}}};
  const double at = std::clamp(share, 0.0, 1.0) * static_cast<double>(kStops.size() - 1);
  const auto i = std::min(static_cast<std::size_t>(at), kStops.size() - 2);
  return mix(kStops[i], kStops[i + 1], at - static_cast<double>(i));
}

double ColourScale::share(double value) const { return top > bottom ? (value - bottom) / (top - bottom) : 0.0; }

double round_step(double span, int parts) {
  if (!(span > 0.0) || !std::isfinite(span)) {
    return 1.0;
  }
  const double least = span / parts;
  const double power = std::pow(10.0, std::floor(std::log10(least)));
  for (const double m : {1.0, 2.0, 5.0}) {
    if (m * power >= least * (1.0 - 1e-9)) {
      return m * power;
    }
  }
  return 10.0 * power;
}

ColourScale colour_scale(std::span<const double> values) {
  std::vector<double> positive;
  double least = 0.0;
  double greatest = 0.0;
  for (const double v : values) {
    if (!std::isfinite(v)) {
      continue;
    }
    least = std::min(least, v);
    greatest = std::max(greatest, v);
    if (v > 0.0) {
      positive.push_back(v);
    }
  }
  double top = greatest;
  if (positive.size() >= 20) {
    const auto nth = positive.begin() + static_cast<std::ptrdiff_t>(positive.size() * 98 / 100);
    std::nth_element(positive.begin(), nth, positive.end());
    top = greatest > 2.0 * *nth ? *nth : greatest;
  }
  ColourScale scale;
  if (!(top > least)) {
    scale.ticks = {0.0, 1.0};  // nothing but zeros
    return scale;
  }
  const double step = round_step(top - least, 5);
  scale.bottom = std::floor(least / step) * step;
  const auto steps = static_cast<int>(std::ceil((top - scale.bottom) / step - 1e-9));
  for (int i = 0; i <= steps; ++i) {
    scale.ticks.push_back(scale.bottom + i * step);
  }
  scale.top = scale.ticks.back();
  scale.clipped_above = greatest > scale.top * (1.0 + 1e-9);
  return scale;
}

}  // namespace tacho::report
