// Asks a mirror. Ends with 5 where there is no server.
#include <client/mirror/mirror.h>

#include <iostream>

int main(int argc, char** argv) {
  clearance::client::MirrorOptions options;
  if (argc > 1) options.client.address = argv[1];
  const auto mirror = clearance::client::Mirror::Start(options);
  if (!mirror.ok()) return 1;
  const absl::Status ready = (*mirror)->WaitUntilReady(absl::Milliseconds(200));
  if (!ready.ok()) {
    std::cerr << ready << "\n";
    return (*mirror)->Distances(Eigen::Vector3d(10, 2, 0.5), 0).ok() ? 1 : 5;
  }
  std::cout << (*mirror)->Distances(Eigen::Vector3d(10, 2, 0.5), 0)->distances_m[0] << " m\n";
  return 0;
}
