// Asks how far the nearest surface is. Ends with 5 where there is no server.
#include <client/esdf_client.h>

#include <iostream>

int main(int argc, char** argv) {
  clearance::client::ClientOptions options;
  if (argc > 1) options.address = argv[1];
  options.connect_timeout = absl::Milliseconds(500);
  const auto client = clearance::client::EsdfClient::Connect(options);
  if (!client.ok()) {
    std::cerr << client.status() << "\n";
    return 5;
  }
  const auto answers = (*client)->QueryPoints(Eigen::Vector3d(10, 2, 0.5));
  if (!answers.ok()) {
    std::cerr << answers.status() << "\n";
    return 1;
  }
  std::cout << answers->distances_m[0] << " m\n";
  return 0;
}
