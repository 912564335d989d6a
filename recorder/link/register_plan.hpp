#pragma once
// Which register ranges to ask for, and what the robot taught us about them. Pure: asks through a callback.
//
// A refused range that spans undocumented registers is replaced by the documented runs inside it. A refused documented
// run is searched by bisection: ask the left half; when it answers, the culprit is in the right half, which need not be
// asked. The last value left is asked alone, so that a server that merely refuses long requests does not lose a
// register. For a run of n values this costs ceil(log2 n) + 2 requests, the rest of the run included.
//
// A range that is met with silence costs the connection and the time of the sweep, so it cannot be searched: it is
// asked last, and left out as a whole when the owner says so.

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "schema/wire/registers.hpp"

namespace tacho::recorder {

enum class Reply : std::uint8_t {
  ok,
  bad_address,  ///< exception 2
  bad_count,    ///< exception 3
  failed,       ///< anything else; teaches nothing about addresses
  stop,         ///< connection lost or out of time: ask nothing more in this sweep
};

class RegisterPlan {
 public:
  using Ask = std::function<Reply(wire::Range)>;

  explicit RegisterPlan(bool discrete);

  /// One sweep: asks for every range, learns from refusals. What was refused for good in this sweep and is not asked
  /// again until forget() is returned; what could not be read but will be asked again is the caller's to know, from
  /// Ask.
  /// `last`: the range, or a part of one, that is asked after all others.
  std::vector<wire::Range> sweep(const Ask& ask, const std::optional<wire::Range>& last = std::nullopt);
  /// This range of ranges() is never answered. When it spans undocumented registers, its documented runs are asked for
  /// from now on, and false is returned; else it is not asked again until forget().
  bool leave_out(wire::Range range);

  [[nodiscard]] const std::vector<wire::Range>& ranges() const { return ranges_; }
  [[nodiscard]] const std::vector<wire::Range>& illegal() const { return illegal_; }
  [[nodiscard]] bool learned() const { return learned_; }
  /// Takes over what an earlier plan has learned. False, and nothing changed, when these cannot be the ranges of such a
  /// plan: documented registers, no value split, nothing asked that is illegal, everything else asked.
  [[nodiscard]] bool restore(const std::vector<wire::Range>& ranges, const std::vector<wire::Range>& illegal);
  /// Back to the first plan: a restarted or updated robot may answer what it refused before.
  void forget();

  static constexpr int kMaxExtraRequests = 8;  ///< per sweep, for bisection

 private:
  struct Pieces {
    std::vector<wire::Range> good;     // answered, in any order
    std::vector<wire::Range> unknown;  // not settled: ask again next time
    std::vector<wire::Range> illegal;
    std::optional<wire::Range> last;     // not to be asked yet
    std::optional<wire::Range> put_off;  // what holds it
    bool refused = false;                // something was
    bool stop = false;
  };
  void visit(wire::Range range, const Ask& ask, int& extra, Pieces& out) const;
  void ask_range(wire::Range range, const Ask& ask, int& extra, Pieces& out) const;
  std::vector<wire::Range> learn(const Pieces& pieces);
  Reply ask_run(wire::Range run, const Ask& ask, int& extra, Pieces& out) const;
  void bisect(wire::Range refused, const Ask& ask, int& extra, Pieces& out) const;
  void halve(wire::Range refused, const Ask& ask, int& extra, Pieces& out) const;
  [[nodiscard]] std::vector<wire::Range> runs_inside(wire::Range range) const;
  [[nodiscard]] bool spans_gaps(wire::Range range) const;
  void drop_answered();
  [[nodiscard]] std::vector<wire::Range> split(wire::Range range) const;

  bool discrete_;
  bool learned_ = false;
  std::vector<wire::Range> ranges_;
  std::vector<wire::Range> illegal_;
};

}  // namespace tacho::recorder
