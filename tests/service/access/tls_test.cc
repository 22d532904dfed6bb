// TLS over a real port: who trusts whom, certificates that change, files that are no good.
#include <filesystem>
#include <fstream>

#include "client/esdf_client.h"
#include "server/service/access/access_list.h"
#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;

// A folder of keys and certificates, made by openssl.
class Authority {
 public:
  explicit Authority(const std::string& name)
      : folder_(::testing::TempDir() + "tls_" + name + "_" + std::to_string(getpid())) {
    std::filesystem::create_directories(folder_);
    Run("openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 -subj "
        "'/CN=" +
        name + "' -keyout ca.key -out ca.pem");
  }
  ~Authority() { std::filesystem::remove_all(folder_); }

  std::string Path(const std::string& file) const { return folder_ + "/" + file; }
  // NAME.pem and NAME.key, signed by ca.pem, valid for `host` too.
  void Issue(const std::string& name, const std::string& common_name,
             const std::string& host = "localhost") const {
    Run("openssl req -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -subj '/CN=" +
        common_name + "' -keyout " + name + ".key -out " + name + ".csr");
    std::ofstream(Path("san.cnf")) << "subjectAltName=DNS:" << host << ",IP:127.0.0.1\n";
    Run("openssl x509 -req -in " + name + ".csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 2 " +
        "-extfile san.cnf -out " + name + ".pem");
  }

 private:
  void Run(const std::string& command) const {
    ASSERT_EQ(std::system(("cd '" + folder_ + "' && " + command + " 2>openssl.log").c_str()), 0)
        << command;
  }
  const std::string folder_;
};

class TlsTest : public ServiceFixture {
 protected:
  void Serve(const TlsFiles& tls, const std::string& access_file = "") {
    RegistryOptions maps;
    maps.model = FakeModelFactory(log_);
    registry_ = std::make_unique<MapRegistry>(maps);
    ASSERT_TRUE(registry_->Create("default", {}).ok());
    ServerOptions options;
    options.listen = {"localhost:0"};
    options.tls = tls;
    options.access_file = access_file;
    auto server = ClearanceServer::Start(registry_.get(), options);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
  }
  absl::Status Ask(const client::Credentials& credentials) {
    client::ClientOptions options;
    options.address = server_->addresses()[0];
    options.credentials = credentials;
    options.connect_timeout = absl::Seconds(2);
    const auto client = client::EsdfClient::Connect(options);
    if (!client.ok()) return client.status();
    return (*client)->GetMap("default").status();
  }

  Authority ours_{"ours"}, theirs_{"theirs"};
};

TEST_F(TlsTest, ServesThoseWhoTrustItsAuthority) {
  ours_.Issue("server", "localhost");
  Serve({ours_.Path("server.pem"), ours_.Path("server.key"), ""});
  EXPECT_EQ(Ask({.tls_ca = ours_.Path("ca.pem")}), absl::OkStatus());
  EXPECT_TRUE(absl::IsUnavailable(Ask({.tls_ca = theirs_.Path("ca.pem")})));
  EXPECT_TRUE(absl::IsUnavailable(Ask({})));  // plain text into a TLS port
}

TEST_F(TlsTest, AsksForClientCertificatesOfItsAuthority) {
  ours_.Issue("server", "localhost");
  ours_.Issue("robot", "robot-7", "robot-7");
  theirs_.Issue("robot", "robot-7", "robot-7");
  Serve({ours_.Path("server.pem"), ours_.Path("server.key"), ours_.Path("ca.pem")});
  const std::string ca = ours_.Path("ca.pem");
  EXPECT_EQ(Ask({.tls_ca = ca,
                 .tls_certificate = ours_.Path("robot.pem"),
                 .tls_key = ours_.Path("robot.key")}),
            absl::OkStatus());
  EXPECT_TRUE(absl::IsUnavailable(Ask({.tls_ca = ca})));
  EXPECT_TRUE(absl::IsUnavailable(Ask({.tls_ca = ca,
                                       .tls_certificate = theirs_.Path("robot.pem"),
                                       .tls_key = theirs_.Path("robot.key")})));
}

TEST_F(TlsTest, MapsCertificateNamesAndTokensToRights) {
  ours_.Issue("server", "localhost");
  ours_.Issue("robot", "robot-7", "robot-7");
  ours_.Issue("other", "robot-8", "robot-8");
  const std::string access = ours_.Path("access.yaml");
  std::ofstream(access) << "callers:\n  - name: seven\n    certificate: robot-7\n    maps: "
                           "{default: [read]}\n  - name: eight\n    token_sha256: "
                        << Sha256Hex("eight") << "\n    maps: {default: [read]}\n";
  const std::string ca = ours_.Path("ca.pem");
  Serve({ours_.Path("server.pem"), ours_.Path("server.key"), ca}, access);
  const client::Credentials seven{
      .tls_ca = ca, .tls_certificate = ours_.Path("robot.pem"), .tls_key = ours_.Path("robot.key")};
  client::Credentials eight{
      .tls_ca = ca, .tls_certificate = ours_.Path("other.pem"), .tls_key = ours_.Path("other.key")};
  EXPECT_EQ(Ask(seven), absl::OkStatus());
  EXPECT_TRUE(absl::IsUnauthenticated(Ask(eight)));
  eight.token = "eight";
  EXPECT_EQ(Ask(eight), absl::OkStatus());
  eight.token = "nine";
  EXPECT_TRUE(absl::IsUnauthenticated(Ask(eight)));
}

TEST_F(TlsTest, ServesRenewedCertificatesWithoutRestart) {
  ours_.Issue("server", "localhost");
  theirs_.Issue("server", "localhost");
  Serve({ours_.Path("server.pem"), ours_.Path("server.key"), ""});
  ASSERT_EQ(Ask({.tls_ca = ours_.Path("ca.pem")}), absl::OkStatus());
  for (const char* file : {"server.key", "server.pem"}) {
    std::filesystem::copy_file(theirs_.Path(file), ours_.Path(file),
                               std::filesystem::copy_options::overwrite_existing);
  }
  while (!Ask({.tls_ca = theirs_.Path("ca.pem")}).ok()) usleep(100'000);
  EXPECT_TRUE(absl::IsUnavailable(Ask({.tls_ca = ours_.Path("ca.pem")})));
}

TEST_F(TlsTest, RefusesFilesThatAreNoGood) {
  ours_.Issue("server", "localhost");
  theirs_.Issue("server", "localhost");
  std::ofstream(ours_.Path("text")) << "not a certificate\n";
  const std::string pem = ours_.Path("server.pem"), key = ours_.Path("server.key");
  const struct {
    TlsFiles files;
    absl::StatusCode code;
    const char* says;
  } cases[] = {
      {{"/nowhere/a.pem", key, ""}, absl::StatusCode::kNotFound, "security.certificate /nowhere"},
      {{pem, "/nowhere/a.key", ""}, absl::StatusCode::kNotFound, "security.key /nowhere"},
      {{ours_.Path("text"), key, ""}, absl::StatusCode::kInvalidArgument, "no PEM certificate"},
      {{pem, ours_.Path("text"), ""}, absl::StatusCode::kInvalidArgument, "no PEM key"},
      {{pem, theirs_.Path("server.key"), ""}, absl::StatusCode::kInvalidArgument, "is not the key"},
      {{pem, key, ours_.Path("text")}, absl::StatusCode::kInvalidArgument, "security.client_ca"},
  };
  RegistryOptions maps;
  maps.model = FakeModelFactory(log_);
  MapRegistry registry(maps);
  for (const auto& c : cases) {
    ServerOptions options;
    options.listen = {"localhost:0"};
    options.tls = c.files;
    const auto server = ClearanceServer::Start(&registry, options);
    EXPECT_EQ(server.status().code(), c.code) << server.status();
    EXPECT_THAT(std::string(server.status().message()), HasSubstr(c.says));
  }
}

TEST_F(TlsTest, ClientNamesWhatItCannotUse) {
  const std::string ca = ours_.Path("ca.pem");
  client::ClientOptions options;
  options.credentials = {.tls_ca = "/nowhere/ca.pem"};
  EXPECT_THAT(std::string(client::EsdfClient::Connect(options).status().message()),
              HasSubstr("TLS CA /nowhere/ca.pem"));
  options.credentials = {.tls_ca = ca, .tls_certificate = ca};
  EXPECT_THAT(std::string(client::EsdfClient::Connect(options).status().message()),
              HasSubstr("expected both"));
}

}  // namespace
}  // namespace clearance
