#pragma once
// The addresses of a host, with a deadline. The system's resolver knows none, so it works on a thread of its own, which
// nobody waits for longer than he wants to.

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "schema/sample.hpp"

struct addrinfo;

namespace tacho::recorder {

/// One owner thread; only interrupt() may be called from another.
class Resolver {
 public:
  using Addresses = std::shared_ptr<const addrinfo>;
  struct Answer {
    int error = 0;  ///< as getaddrinfo() returns it
    Addresses addresses;
  };
  /// From a thread of its own, which may outlive the resolver.
  using Lookup = std::function<Answer(const std::string& host, std::uint16_t port)>;

  /// `lookup` empty: the system's.
  Resolver(std::string host, std::uint16_t port, Lookup lookup = {});

  struct Found {
    Addresses addresses;  ///< null: none
    std::string problem;  ///< then in words
  };
  /// A name is looked up at every call. While no name server answers, what it was the last time stands; half of the
  /// time until `deadline_us` (monotonic) is left for those addresses.
  [[nodiscard]] Found find(Micros deadline_us);
  /// Ends find(), now and later.
  void interrupt();

 private:
  struct Running;
  [[nodiscard]] bool start();

  std::string host_;
  std::uint16_t port_;
  Lookup lookup_;
  std::shared_ptr<Running> running_;
  Addresses last_;
  bool numeric_ = false;
};

}  // namespace tacho::recorder
