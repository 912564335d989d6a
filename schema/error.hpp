#pragma once
// A broken environment (cannot open, disk full, newer schema) throws Error once and `main` explains it.
// Bad input data is counted and stored, never thrown; a bug is an assert.

#include <stdexcept>
#include <string>

namespace tacho {

/// `what` names the thing, `cause` what the system said, `remedy` what the user can do. Lower case, no full stop.
class Error : public std::runtime_error {
 public:
  Error(const std::string& what, const std::string& cause, const std::string& remedy)
      : std::runtime_error(what + ": " + cause + (remedy.empty() ? "" : "; " + remedy)) {}
};

}  // namespace tacho
