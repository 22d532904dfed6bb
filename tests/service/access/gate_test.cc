// Every RPC of the contract times every kind of caller: who gets through, and nobody else.
#include <google/protobuf/message.h>
#include <grpcpp/generic/generic_stub.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>

#include "server/service/access/access_list.h"
#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FileDescriptor;
using google::protobuf::Message;
using google::protobuf::MethodDescriptor;

enum class Where { kYard, kEverywhere, kSomewhere };
struct Rule {
  Right right;
  Where where;
};

// What the documentation promises. An RPC that is not here fails the test.
const std::map<std::string, Rule>& Rules() {
  static const auto& rules = *new std::map<std::string, Rule>{
      {"IngestService.IngestFrames", {Right::kIngest, Where::kYard}},
      {"IngestService.IngestFrame", {Right::kIngest, Where::kYard}},
      {"QueryService.QueryPoints", {Right::kRead, Where::kYard}},
      {"QueryService.CheckTrajectories", {Right::kRead, Where::kYard}},
      {"QueryService.CheckSpheres", {Right::kRead, Where::kYard}},
      {"QueryService.ListObjects", {Right::kRead, Where::kYard}},
      {"QueryService.GetSlice", {Right::kRead, Where::kYard}},
      {"QueryService.GetRegion", {Right::kRead, Where::kYard}},
      {"QueryService.QueryStream", {Right::kRead, Where::kYard}},
      {"QueryService.PinRevision", {Right::kRead, Where::kYard}},
      {"QueryService.ReleasePin", {Right::kRead, Where::kYard}},
      {"MapService.CreateMap", {Right::kAdmin, Where::kYard}},
      {"MapService.GetMap", {Right::kRead, Where::kYard}},
      {"MapService.ListMaps", {Right::kRead, Where::kEverywhere}},
      {"MapService.DeleteMap", {Right::kAdmin, Where::kYard}},
      {"MapService.EditRegion", {Right::kAdmin, Where::kYard}},
      {"MapService.RepositionSubmaps", {Right::kAdmin, Where::kYard}},
      {"ExportService.ExportMesh", {Right::kRead, Where::kYard}},
      {"ExportService.ExportGrid", {Right::kRead, Where::kYard}},
      {"WatchService.WatchMap", {Right::kRead, Where::kYard}},
      {"SnapshotService.CreateSnapshot", {Right::kAdmin, Where::kYard}},
      {"SnapshotService.ListSnapshots", {Right::kRead, Where::kYard}},
      {"SnapshotService.RestoreSnapshot", {Right::kAdmin, Where::kYard}},
      {"SnapshotService.DeleteSnapshot", {Right::kAdmin, Where::kYard}},
      {"AdminService.GetServerInfo", {Right::kRead, Where::kSomewhere}},
      {"AdminService.GetStats", {Right::kRead, Where::kYard}},
      {"AdminService.Drain", {Right::kAdmin, Where::kEverywhere}},
  };
  return rules;
}

struct Role {
  std::string token;  // sent; empty = none
  bool known = true;
  std::map<std::string, std::vector<Right>> rights;  // "*" = every map
};

std::vector<Role> Roles() {
  const std::vector<Right> all = {Right::kRead, Right::kIngest, Right::kAdmin};
  return {{"", false, {}},
          {"guess", false, {}},
          {"reader", true, {{"yard", {Right::kRead}}}},
          {"sensor", true, {{"yard", {Right::kIngest}}}},
          {"keeper", true, {{"yard", {Right::kAdmin}}}},
          {"stranger", true, {{"hall", all}}},
          {"watcher", true, {{"*", {Right::kRead}}}},
          {"master", true, {{"*", all}}}};
}

std::string AccessFile() {
  std::string yaml = "callers:\n";
  for (const Role& role : Roles()) {
    if (!role.known) continue;
    yaml += "  - name: " + role.token + "\n    token_sha256: " + Sha256Hex(role.token) +
            "\n    maps:\n";
    for (const auto& [map, rights] : role.rights) {
      yaml += "      \"" + map + "\": [";
      for (size_t i = 0; i < rights.size(); ++i)
        yaml += (i ? ", " : "") + std::string(NameOf(rights[i]));
      yaml += "]\n";
    }
  }
  return yaml;
}

bool Has(const Role& role, const std::string& map, Right right) {
  const auto it = role.rights.find(map);
  return it != role.rights.end() &&
         std::find(it->second.begin(), it->second.end(), right) != it->second.end();
}

bool Allowed(const Role& role, const Rule& rule) {
  if (Has(role, "*", rule.right)) return true;
  if (rule.where == Where::kEverywhere) return false;
  if (rule.where == Where::kYard) return Has(role, "yard", rule.right);
  for (const auto& [map, rights] : role.rights) {
    if (Has(role, map, rule.right)) return true;
  }
  return false;
}

// A request for the map `yard`, wherever the message names one.
void NameYard(Message* message) {
  const Descriptor* type = message->GetDescriptor();
  const auto* reflection = message->GetReflection();
  if (const auto* map = type->FindFieldByName("map")) reflection->SetString(message, map, "yard");
  if (const auto* open = type->FindFieldByName("open")) {
    NameYard(reflection->MutableMessage(message, open));
  }
  if (const auto* query = type->FindFieldByName("query_points")) {
    NameYard(reflection->MutableMessage(message, query));
  }
}

class GateTest : public ServiceFixture {
 protected:
  void SetUp() override {
    path_ = ::testing::TempDir() + "access_" + std::to_string(getpid()) + ".yaml";
    std::ofstream(path_) << AccessFile();
    ServerOptions options;
    options.access_file = path_;
    StartServer(RegistryOptions{}, options);
    ASSERT_TRUE(registry_->Create("yard", options.limits.map_defaults).ok());
  }
  void TearDown() override { unlink(path_.c_str()); }

  // One message sent, half-closed, replies read to the end. A reply of type Error counts as the
  // call's status: QueryStream answers each request on its own.
  grpc::Status Call(const MethodDescriptor& method, const std::string& token) {
    std::unique_ptr<Message> request(google::protobuf::MessageFactory::generated_factory()
                                         ->GetPrototype(method.input_type())
                                         ->New());
    NameYard(request.get());
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
    if (!token.empty()) context.AddMetadata("authorization", "Bearer " + token);
    grpc::GenericStub stub(channel_);
    grpc::CompletionQueue queue;
    const auto next = [&queue] {
      void* tag = nullptr;
      bool ok = false;
      return queue.Next(&tag, &ok) && ok;
    };
    auto call = stub.PrepareCall(&context,
                                 "/" + method.service()->full_name() + "/" + method.name(), &queue);
    call->StartCall(nullptr);
    next();
    const std::string bytes = request->SerializeAsString();
    grpc::Slice slice(bytes);
    call->Write(grpc::ByteBuffer(&slice, 1), nullptr);
    if (next()) {
      call->WritesDone(nullptr);
      next();
    }
    grpc::Status in_stream;
    const bool endless = method.full_name() == "clearance.v1.WatchService.WatchMap";
    for (grpc::ByteBuffer reply;;) {
      call->Read(&reply, nullptr);
      if (!next()) break;
      if (endless) context.TryCancel();  // it was let in
      if (method.name() != "QueryStream") continue;
      std::vector<grpc::Slice> slices;
      reply.Dump(&slices);
      std::string all;
      for (const grpc::Slice& s : slices)
        all.append(reinterpret_cast<const char*>(s.begin()), s.size());
      v1::QueryStreamResponse answer;
      if (answer.ParseFromString(all) && answer.has_error()) {
        in_stream = grpc::Status(static_cast<grpc::StatusCode>(answer.error().code()),
                                 answer.error().message());
      }
    }
    grpc::Status status;
    call->Finish(&status, nullptr);
    next();
    return status.ok() ? in_stream : status;
  }

  std::string path_;
  int writes_ = 0;
};

TEST_F(GateTest, LetsThroughExactlyWhoMay) {
  const FileDescriptor* files[] = {v1::IngestFramesRequest::descriptor()->file(),
                                   v1::QueryPointsRequest::descriptor()->file(),
                                   v1::CreateMapRequest::descriptor()->file(),
                                   v1::ExportMeshRequest::descriptor()->file(),
                                   v1::WatchMapRequest::descriptor()->file(),
                                   v1::CreateSnapshotRequest::descriptor()->file(),
                                   v1::GetStatsRequest::descriptor()->file()};
  int calls = 0, refused = 0, rpcs = 0;
  for (const FileDescriptor* file : files) {
    for (int s = 0; s < file->service_count(); ++s) {
      for (int m = 0; m < file->service(s)->method_count(); ++m) {
        const MethodDescriptor& method = *file->service(s)->method(m);
        const std::string name = method.service()->name() + "." + method.name();
        ++rpcs;
        const auto rule = Rules().find(name);
        ASSERT_NE(rule, Rules().end()) << name << " has no rule: who may call it?";
        for (const Role& role : Roles()) {
          const bool allowed = Allowed(role, rule->second);
          if (allowed && name == "AdminService.Drain") continue;  // it would work
          const grpc::Status status = Call(method, role.token);
          ++calls;
          if (allowed) {
            EXPECT_NE(status.error_code(), grpc::StatusCode::UNAUTHENTICATED) << name;
            EXPECT_NE(status.error_code(), grpc::StatusCode::PERMISSION_DENIED)
                << name << " refuses " << role.token << ": " << status.error_message();
            continue;
          }
          ++refused;
          EXPECT_EQ(status.error_code(), role.known ? grpc::StatusCode::PERMISSION_DENIED
                                                    : grpc::StatusCode::UNAUTHENTICATED)
              << name << " for '" << role.token << "': " << status.error_message();
          EXPECT_EQ(status.error_message().find("guess"), std::string::npos);
        }
      }
    }
  }
  EXPECT_EQ(rpcs, static_cast<int>(Rules().size()));
  EXPECT_GT(refused, 4 * rpcs);
  RecordProperty("calls", calls);
  // Nobody without the right changed anything.
  EXPECT_EQ(registry_->Get("default").status(), absl::OkStatus());
}

TEST_F(GateTest, HealthNeedsNoToken) {
  grpc::ClientContext context;
  grpc::health::v1::HealthCheckResponse response;
  EXPECT_TRUE(health_->Check(&context, {}, &response).ok());
}

TEST_F(GateTest, TakesAChangedFileAndKeepsTheLastGoodOne) {
  const auto allowed = [this](const std::string& token) {
    grpc::ClientContext context;
    context.AddMetadata("authorization", "bearer " + token);
    v1::GetMapRequest request;
    request.set_map("yard");
    v1::GetMapResponse response;
    return map_->GetMap(&context, request, &response).ok();
  };
  ASSERT_TRUE(allowed("reader"));
  const auto write = [this](const std::string& text) {
    std::ofstream(path_, std::ios::trunc) << text;
    // The clock of the file system may be coarser than the test.
    std::filesystem::last_write_time(
        path_, std::filesystem::last_write_time(path_) + std::chrono::seconds(++writes_));
  };
  const std::string renewed = "callers:\n  - name: new\n    token_sha256: " + Sha256Hex("renewed") +
                              "\n    maps: {yard: [read]}\n";
  write(renewed);
  while (!allowed("renewed")) usleep(20'000);
  EXPECT_FALSE(allowed("reader"));
  write("callers: [nonsense");
  usleep(1'200'000);  // longer than the server lets pass between two looks
  EXPECT_TRUE(allowed("renewed"));
  EXPECT_FALSE(allowed("reader"));
}

}  // namespace
}  // namespace clearance
