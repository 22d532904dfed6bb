#include "tests/client/live_server.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "absl/time/clock.h"

namespace clearance::client {
namespace {

sockaddr_un SocketAddress(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path.c_str(), sizeof(address.sun_path) - 1);
  return address;
}

bool Forward(int from, int to) {
  char buffer[65536];
  const ssize_t n = read(from, buffer, sizeof(buffer));
  for (ssize_t sent = 0; sent < n;) {
    const ssize_t k = send(to, buffer + sent, static_cast<size_t>(n - sent), MSG_NOSIGNAL);
    if (k <= 0) return false;
    sent += k;
  }
  return n > 0;
}

// Distance along the unit direction to the faces of a box about the origin, from inside.
double ExitDistance(const Eigen::Vector3d& direction, const Eigen::Vector3d& half) {
  return (half.array() / direction.array().abs().max(1e-12)).minCoeff();
}

// Distance at which the ray from the origin enters the box, or infinity.
double EntryDistance(const Eigen::Vector3d& direction, const Eigen::Vector3d& min,
                     const Eigen::Vector3d& max) {
  double near = 0, far = INFINITY;
  for (int i = 0; i < 3; ++i) {
    const double a = min[i] / direction[i], b = max[i] / direction[i];
    near = std::max(near, std::min(a, b));
    far = std::min(far, std::max(a, b));
  }
  return near < far ? near : INFINITY;
}

}  // namespace

LiveServer::LiveServer() {
  pid_ = fork();
  if (pid_ == 0) {
    const std::string log = (folder_.path() / "log").string();
    const int fd = open(log.c_str(), O_CREAT | O_WRONLY, 0644);
    dup2(fd, STDOUT_FILENO);
    dup2(fd, STDERR_FILENO);
    execl(CLEARANCE_SERVER_BINARY, CLEARANCE_SERVER_BINARY, "--listen", "127.0.0.1:0", "--socket",
          address().c_str(), "--http", "off", static_cast<char*>(nullptr));
    _exit(127);
  }
}

LiveServer::~LiveServer() { Terminate(); }

int LiveServer::Terminate() {
  if (pid_ < 0) return -1;
  kill(pid_, SIGTERM);
  int status = 0;
  waitpid(pid_, &status, 0);
  pid_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

std::unique_ptr<EsdfClient> LiveServer::Connect(const std::string& map) const {
  ClientOptions options;
  options.address = address();
  options.map = map;
  options.connect_timeout = absl::Seconds(30);
  auto client = EsdfClient::Connect(options);
  return client.ok() ? *std::move(client) : nullptr;
}

struct CuttingProxy::Pair {
  int client = -1, server = -1;
  std::thread thread;

  void Run() {
    pollfd fds[2] = {{client, POLLIN, 0}, {server, POLLIN, 0}};
    while (poll(fds, 2, -1) > 0) {
      if (fds[0].revents != 0 && !Forward(client, server)) break;
      if (fds[1].revents != 0 && !Forward(server, client)) break;
    }
    shutdown(client, SHUT_RDWR);
    shutdown(server, SHUT_RDWR);
  }
  ~Pair() {
    shutdown(client, SHUT_RDWR);
    shutdown(server, SHUT_RDWR);
    thread.join();
    close(client);
    close(server);
  }
};

CuttingProxy::CuttingProxy(const std::string& target) : target_(target) {
  listener_ = socket(AF_UNIX, SOCK_STREAM, 0);
  const sockaddr_un own = SocketAddress(address());
  bind(listener_, reinterpret_cast<const sockaddr*>(&own), sizeof(own));
  listen(listener_, 16);
  thread_ = std::thread([this] { Accept(); });
}

CuttingProxy::~CuttingProxy() {
  stop_ = true;
  shutdown(listener_, SHUT_RDWR);
  thread_.join();
  close(listener_);
  Cut();
}

void CuttingProxy::Accept() {
  while (!stop_) {
    const int client = accept(listener_, nullptr, nullptr);
    if (client < 0) return;
    auto pair = std::make_unique<Pair>();
    pair->client = client;
    pair->server = socket(AF_UNIX, SOCK_STREAM, 0);
    const sockaddr_un target = SocketAddress(target_);
    connect(pair->server, reinterpret_cast<const sockaddr*>(&target), sizeof(target));
    pair->thread = std::thread([p = pair.get()] { p->Run(); });
    absl::MutexLock lock(&mutex_);
    pairs_.push_back(std::move(pair));
  }
}

int CuttingProxy::Cut() {
  std::vector<std::unique_ptr<Pair>> pairs;
  {
    absl::MutexLock lock(&mutex_);
    pairs.swap(pairs_);
  }
  return static_cast<int>(pairs.size());
}

Frame RoomFrame(uint64_t index, bool with_object) {
  constexpr int kColumns = 256, kRows = 128;
  const Eigen::Vector3d half(3, 3, 1.5);
  const Eigen::Vector3d centre(1.5 + 0.1 * static_cast<double>(index), 0, 0);
  Frame frame;
  frame.frame_id = index;
  frame.stamp_ns = 1'000'000'000 + static_cast<int64_t>(index) * 100'000'000;
  auto& cloud = frame.observation.emplace<PointCloud>();
  cloud.points_X.resize(3, kColumns * kRows);
  cloud.labels.assign(kColumns * kRows, 0);
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const double azimuth = (column + 0.5) * 2 * M_PI / kColumns;
      const double elevation = ((row + 0.5) / kRows - 0.5) * M_PI;
      const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                      std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      double range = ExitDistance(direction, half);
      const int i = row * kColumns + column;
      if (with_object) {
        const Eigen::Vector3d extent = Eigen::Vector3d::Constant(0.3);
        const double object = EntryDistance(direction, centre - extent, centre + extent);
        if (object < range) {
          range = object;
          cloud.labels[i] = 7;
        }
      }
      cloud.points_X.col(i) = (range * direction).cast<float>();
    }
  }
  if (with_object && index > 0) {
    ObjectMotion& motion = frame.motions.emplace_back();
    motion.object_id = ObjectId(7);
    motion.pose.translation() = Eigen::Vector3d(0.1, 0, 0);
    motion.from_frame_id = index - 1;
    motion.class_name = "box";
  }
  return frame;
}

}  // namespace clearance::client
