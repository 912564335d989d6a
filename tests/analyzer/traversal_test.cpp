#include "analyzer/math/traversal.hpp"

#include <random>

#include "tests/support/catch.hpp"

using namespace tacho::math;

namespace {

std::vector<Part> parts_of(Point a, Point b, double cell) {
  std::vector<Part> parts;
  traverse(a, b, cell, [&](const Part& part) { parts.push_back(part); });
  return parts;
}

double length(Point a, Point b) { return std::hypot(b.x - a.x, b.y - a.y); }

}  // namespace

TEST_CASE("a stride is split at every cell border it crosses") {
  const std::vector<Part> parts = parts_of({0.1, 0.1}, {0.6, 0.1}, 0.25);
  REQUIRE(parts.size() == 3);
  CHECK(parts[0].cell == CellIndex{0, 0});
  CHECK(parts[1].cell == CellIndex{1, 0});
  CHECK(parts[2].cell == CellIndex{2, 0});
  CHECK(parts[0].to * 0.5 == Approx(0.15));
  CHECK((parts[1].to - parts[1].from) * 0.5 == Approx(0.25));
  CHECK((parts[2].to - parts[2].from) * 0.5 == Approx(0.1));
}

TEST_CASE("negative coordinates belong to the cell below, not towards zero") {
  CHECK(cell_of({-0.01, 0.01}, 0.25) == CellIndex{-1, 0});
  const std::vector<Part> parts = parts_of({0.1, -0.1}, {-0.1, -0.1}, 0.25);
  REQUIRE(parts.size() == 2);
  CHECK(parts[0].cell == CellIndex{0, -1});
  CHECK(parts[1].cell == CellIndex{-1, -1});
}

TEST_CASE("a stride without length lies wholly in its cell") {
  const std::vector<Part> parts = parts_of({1.3, -2.7}, {1.3, -2.7}, 0.25);
  REQUIRE(parts.size() == 1);
  CHECK(parts[0].cell == cell_of({1.3, -2.7}, 0.25));
  CHECK(parts[0].from == 0.0);
  CHECK(parts[0].to == 1.0);
}

TEST_CASE("a diagonal through corners visits no cell without length") {
  const std::vector<Part> parts = parts_of({0.0, 0.0}, {1.0, 1.0}, 0.25);
  REQUIRE(parts.size() == 4);
  for (const Part& part : parts) {
    CHECK(part.to - part.from == Approx(0.25));
    CHECK(part.cell.i == part.cell.j);
  }
}

TEST_CASE("parts join without hole from 0 to 1 and lie in the cell they name") {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> where(-40.0, 40.0);
  double sum = 0.0;
  double truth = 0.0;
  for (int n = 0; n < 2'000; ++n) {
    const Point a{where(random), where(random)};
    const Point b = n % 5 == 0 ? Point{a.x, where(random)} : Point{where(random), where(random)};
    const double cell = n % 2 == 0 ? 0.25 : 0.5;
    const std::vector<Part> parts = parts_of(a, b, cell);
    REQUIRE(!parts.empty());
    bool joined = parts.front().from == 0.0 && parts.back().to == 1.0;
    bool inside = parts.front().cell == cell_of(a, cell) && parts.back().cell == cell_of(b, cell);
    for (std::size_t k = 0; k < parts.size(); ++k) {
      joined = joined && (k == 0 || parts[k].from == parts[k - 1].to);
      const double mid = (parts[k].from + parts[k].to) / 2.0;
      const Point p{a.x + mid * (b.x - a.x), a.y + mid * (b.y - a.y)};
      inside = inside && std::abs(p.x / cell - (static_cast<double>(parts[k].cell.i) + 0.5)) < 0.5 + 1e-9 &&
               std::abs(p.y / cell - (static_cast<double>(parts[k].cell.j) + 0.5)) < 0.5 + 1e-9;
      sum += (parts[k].to - parts[k].from) * length(a, b);
    }
    CHECK(joined);
    CHECK(inside);
    truth += length(a, b);
  }
  CHECK(std::abs(sum - truth) < 1e-9 * truth);
}

TEST_CASE("driving a stride backwards gives the same metres to the same cells") {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> where(-5.0, 5.0);
  for (int n = 0; n < 200; ++n) {
    const Point a{where(random), where(random)};
    const Point b{where(random), where(random)};
    const std::vector<Part> there = parts_of(a, b, 0.25);
    const std::vector<Part> back = parts_of(b, a, 0.25);
    REQUIRE(there.size() == back.size());
    for (std::size_t k = 0; k < there.size(); ++k) {
      const Part& mirror = back[back.size() - 1 - k];
      CHECK(there[k].cell == mirror.cell);
      CHECK(there[k].to - there[k].from == Approx(mirror.to - mirror.from).margin(1e-9));
    }
  }
}

TEST_CASE("a kilometre in one stride is still exact") {
  const Point a{-512.125, 3.0};
  const Point b{488.3, 901.7};
  double metres = 0.0;
  std::size_t cells = 0;
  traverse(a, b, 0.25, [&](const Part& part) {
    metres += (part.to - part.from) * length(a, b);
    ++cells;
  });
  CHECK(std::abs(metres - length(a, b)) < 1e-9);
  CHECK(cells > 7'000);
}
