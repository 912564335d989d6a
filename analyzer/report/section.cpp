#include "analyzer/report/section.hpp"

#include <algorithm>

namespace tacho {
namespace {

int rank(Verdict verdict) {
  switch (verdict) {
    case Verdict::fail:
      return 0;
    case Verdict::warn:
      return 1;
    case Verdict::unknown:
      return 2;
    case Verdict::pass:
      return 3;
    case Verdict::not_applicable:
      return 4;
  }
  return 5;
}

}  // namespace

std::string_view verdict_name(Verdict verdict) {
  switch (verdict) {
    case Verdict::pass:
      return "PASS";
    case Verdict::warn:
      return "WARN";
    case Verdict::fail:
      return "FAIL";
    case Verdict::unknown:
      return "UNKNOWN";
    case Verdict::not_applicable:
      return "NA";
  }
  return "";
}

std::vector<Finding> worst_first(std::vector<Finding> findings) {
  std::stable_sort(findings.begin(), findings.end(), [](const Finding& a, const Finding& b) {
    return rank(a.verdict) != rank(b.verdict) ? rank(a.verdict) < rank(b.verdict) : a.severity > b.severity;
  });
  return findings;
}

}  // namespace tacho
