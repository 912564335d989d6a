#pragma once
// Colours of a heat map and the scale between values and colours.

#include <span>
#include <string>
#include <vector>

#include "analyzer/report/canvas.hpp"

namespace tacho::report {

/// Share 0..1 -> viridis: ordered in lightness, so also readable by colour-blind people and in grey.
Colour viridis(double share);

/// Where values lie on the palette. `top` is a round number; values above it show as the top colour and the legend says
/// so.
struct ColourScale {
  double bottom = 0.0;
  double top = 1.0;
  bool clipped_above = false;
  std::vector<double> ticks;  ///< round numbers from bottom to top, both included

  [[nodiscard]] double share(double value) const;
};

/// Scale for the finite ones of `values`: from 0 (or a round number below the least, when negative) to the greatest; to
/// the 98 % point of the positive values when the greatest is more than twice that, so that one extreme cell does not
/// turn all others dark.
ColourScale colour_scale(std::span<const double> values);

/// A round step (1, 2 or 5 times a power of ten) that cuts `span` into at most `parts`.
double round_step(double span, int parts);

}  // namespace tacho::report
