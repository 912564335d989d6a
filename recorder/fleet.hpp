#pragma once
// The robots that are being asked, each with its threads, and what has become of the streams of those that no longer
// are. Numbers of polls of a stream go on where they were when a robot comes back.
//
// Thread rule: start(), stop() of one robot, retire() and join() from one thread; everything else from any.

#include <array>
#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "recorder/clock.hpp"
#include "recorder/config.hpp"
#include "recorder/health.hpp"
#include "recorder/link/link_memory.hpp"
#include "recorder/link/modbus_link.hpp"
#include "recorder/link/push_link.hpp"
#include "recorder/link/tcp_link.hpp"
#include "recorder/poller.hpp"
#include "recorder/snapshot.hpp"

namespace tacho::recorder {

/// How a configured robot is asked on each connection; nothing is remembered of it yet.
TcpLinkOptions status_link_options(const RobotConfig& robot, std::shared_ptr<StatusHint> hint);
ModbusLinkOptions modbus_link_options(const RobotConfig& robot, std::shared_ptr<StatusHint> hint);

/// Makes the link of one robot; tests put their own in.
using LinkFactory = std::function<std::unique_ptr<Link>(const RobotConfig&, Protocol)>;
/// Links over sockets that share what they learn through `memory`.
LinkFactory make_links(std::shared_ptr<LinkMemory> memory);

class Fleet {
 public:
  struct Options {
    LinkFactory make = make_links(std::make_shared<LinkMemory>());
    SessionId session = 0;
    Micros end_us = 0;  ///< monotonic; no poll is due later
    /// Where this row of the log was asked another robot answers. From the thread of a poller, which counts as running
    /// until it returns: it must not wait for the fleet.
    std::function<void(RobotId row, const Identity& other)> stranger;
  };
  /// The robot of the log that is recorded.
  struct Row {
    RobotId id = 0;
    std::string name;   ///< in the log; differs from the configured one when another robot was found there
    Identity identity;  ///< as far as it is known
  };
  /// `sink` must outlive it.
  Fleet(Options options, Sink& sink) : options_(std::move(options)), sink_(sink) {}
  ~Fleet();  ///< stops and joins
  Fleet(const Fleet&) = delete;
  Fleet& operator=(const Fleet&) = delete;

  /// Polls are due from `start_us` (monotonic) on. `index`: place in the configuration; keeps the first polls of robots
  /// apart.
  void start(const RobotConfig& robot, const Row& row, std::size_t index, Micros start_us);
  /// Tells the threads of one robot to end; does not wait.
  void stop(RobotId row);
  /// Ends the polling of one robot; returns when its last row is in the sink. Its identity, as it is known now.
  Identity retire(RobotId row);
  /// Of the robots that are asked, as they are known now; by row of the log.
  [[nodiscard]] std::map<RobotId, Identity> identities() const;
  /// Ends all polling; does not wait.
  void stop();
  void join();

  /// Threads that still poll.
  [[nodiscard]] std::size_t running() const { return running_; }

  struct StreamCounts {
    std::string robot;
    RobotId id = 0;
    Source source = Source::status;
    Micros period_us = 0;       ///< in force; 0: nobody asks any more
    Micros last_period_us = 0;  ///< of a stream that nobody asks any more
    std::uint64_t planned = 0;
    std::array<std::uint64_t, kCauseCount> missed{};
  };
  /// Robots in the order they were started, then the streams that have ended.
  [[nodiscard]] std::vector<StreamCounts> streams() const;
  [[nodiscard]] std::vector<LinkNow> links() const;
  [[nodiscard]] std::vector<Beat> beats() const;

 private:
  using StreamId = std::pair<RobotId, Source>;
  /// One connection: a clock of its own, so that it can be stopped alone.
  struct Station {
    Protocol protocol;
    Micros timeout_us = 0;
    HostClock clock;
    std::unique_ptr<Poller> poller;
    std::thread thread;
    std::atomic<bool> ended{false};
    void stop();
  };
  struct Crew {
    std::string robot;  // as the log names it
    RobotId id = 0;
    std::unique_ptr<RobotWatch> watch;
    std::vector<std::unique_ptr<Station>> stations;
  };
  void dismiss(Crew& crew);
  std::unique_ptr<Station> make_station(const RobotConfig& robot, const Crew& crew, std::size_t index,
                                        Protocol protocol);
  void run(Station& station, Micros start_us);
  [[nodiscard]] StreamCounts counts_of(const Crew& crew, const Poller& poller, std::size_t lane) const;

  const Options options_;
  Sink& sink_;
  AnswerReader reader_;
  std::atomic<std::size_t> running_{0};
  mutable std::mutex mutex_;  // the two below
  std::vector<std::unique_ptr<Crew>> crews_;
  std::map<StreamId, StreamCounts> ended_;  // sums over all pollers a stream has had
};

}  // namespace tacho::recorder
