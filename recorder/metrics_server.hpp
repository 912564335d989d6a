#pragma once
// GET /metrics over HTTP, from threads of its own. Serves nothing else and takes no input but the path.

#include <functional>
#include <memory>
#include <string>

namespace tacho::recorder {

class MetricsServer {
 public:
  /// `listen`: "HOST:PORT" as parse_listen() gives it; port 0 is any. `text` is called from the server's threads.
  /// Throws Error when the port cannot be had.
  MetricsServer(const std::string& listen, std::function<std::string()> text);
  ~MetricsServer();
  MetricsServer(const MetricsServer&) = delete;
  MetricsServer& operator=(const MetricsServer&) = delete;
  [[nodiscard]] int port() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tacho::recorder
