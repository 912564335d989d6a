#include "recorder/metrics_server.hpp"

#include <httplib.h>
#include <sys/socket.h>

#include <atomic>
#include <thread>
#include <utility>

#include "recorder/metrics.hpp"
#include "schema/error.hpp"

namespace tacho::recorder {

namespace {

constexpr std::size_t kThreads = 2;  // one scraper, one person with a browser

}  // namespace

struct MetricsServer::Impl {
  httplib::Server server;
  int port = 0;
  std::atomic<bool> ended{false};
  std::thread thread;
};

MetricsServer::MetricsServer(const std::string& listen, std::function<std::string()> text)
    : impl_(std::make_unique<Impl>()) {
  const std::size_t colon = listen.rfind(':');
  std::string host = listen.substr(0, colon);
  if (host.front() == '[') {
    host = host.substr(1, host.size() - 2);
  }
  httplib::Server& server = impl_->server;
  server.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
  server.set_socket_options([](socket_t socket) {
    const int yes = 1;  // not SO_REUSEPORT, the library's default: two recorders would share the port unnoticed
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  server.set_read_timeout(2);
  server.set_write_timeout(2);
  server.set_payload_max_length(0);
  server.Get("/metrics", [text = std::move(text)](const httplib::Request&, httplib::Response& response) {
    response.set_content(text(), std::string(kMetricsContentType).c_str());
  });
  server.Get("/", [](const httplib::Request&, httplib::Response& response) {
    response.set_content("tacho-recorder: see /metrics\n", "text/plain");
  });
  const int wanted = std::stoi(listen.substr(colon + 1));
  impl_->port = wanted != 0 ? wanted : server.bind_to_any_port(host.c_str());
  if (impl_->port <= 0 || (wanted != 0 && !server.bind_to_port(host.c_str(), wanted))) {
    throw Error("metrics " + listen, "cannot listen there",
                "is the address one of this computer, and the port free? choose another, or metrics = \"off\"");
  }
  impl_->thread = std::thread([this] {
    impl_->server.listen_after_bind();
    impl_->ended = true;
  });
}

MetricsServer::~MetricsServer() {
  while (!impl_->server.is_running() && !impl_->ended) {
    std::this_thread::yield();  // stop() before that would be overheard
  }
  impl_->server.stop();
  impl_->thread.join();
}

int MetricsServer::port() const { return impl_->port; }

}  // namespace tacho::recorder
