// CheckTrajectories and CheckSpheres over the wire: bad input, times, fuzz.
#include <functional>
#include <random>

#include "clearance/v1/query.pb.h"
#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;
using Code = grpc::StatusCode;
using Request = v1::CheckTrajectoriesRequest;

constexpr double kIdentity[] = {0, 0, 0, 0, 0, 0, 1};

std::string Poses(int n, double spacing_m = 0.1) {
  std::vector<double> values;
  for (int i = 0; i < n; ++i) {
    values.insert(values.end(), std::begin(kIdentity), std::end(kIdentity));
    values[7 * i] = spacing_m * i;
  }
  return Bytes(values);
}

Request Good() {
  Request request;
  request.set_spheres_f32(Bytes(std::vector<float>{0, 0, 0, 0.5f}));
  request.set_unknown_policy(v1::UNKNOWN_POLICY_AS_FREE);
  for (int i = 0; i < 2; ++i) {
    v1::Trajectory* trajectory = request.add_trajectories();
    trajectory->set_waypoints_f64(Poses(3));
    trajectory->set_times_f64(Bytes(std::vector<double>{0, 1, 2}));
  }
  return request;
}

struct BadCheck {
  const char* name;
  Code code;
  std::vector<std::string> said;
  std::function<void(Request*)> spoil;
};

void SetTimes(Request* r, std::vector<double> times) {
  r->mutable_trajectories(1)->set_times_f64(Bytes(times));
}
void SetPose(Request* r, int value, double to) {
  std::vector<double> poses = Values<double>(r->trajectories(0).waypoints_f64());
  poses[7 + value] = to;
  r->mutable_trajectories(0)->set_waypoints_f64(Bytes(poses));
}

const BadCheck kBadChecks[] = {
    {"no trajectories",
     Code::INVALID_ARGUMENT,
     {"trajectories", "0", "10000"},
     [](Request* r) { r->clear_trajectories(); }},
    {"an empty trajectory",
     Code::INVALID_ARGUMENT,
     {"trajectories[1].waypoints_f64", "0 waypoints"},
     [](Request* r) { r->mutable_trajectories(1)->Clear(); }},
    {"length of waypoints",
     Code::INVALID_ARGUMENT,
     {"trajectories[0].waypoints_f64", "55", "56"},
     [](Request* r) { r->mutable_trajectories(0)->set_waypoints_f64(std::string(55, 0)); }},
    {"length of times",
     Code::INVALID_ARGUMENT,
     {"trajectories[1].times_f64", "7 bytes"},
     [](Request* r) { r->mutable_trajectories(1)->set_times_f64("1234567"); }},
    {"another number of times",
     Code::INVALID_ARGUMENT,
     {"trajectories[1].times_f64", "2", "3"},
     [](Request* r) {
       SetTimes(r, {0, 1});
     }},
    {"unsorted times",
     Code::INVALID_ARGUMENT,
     {"trajectories[1].times_f64[2]", "ascending"},
     [](Request* r) {
       SetTimes(r, {0, 2, 1});
     }},
    {"equal times",
     Code::INVALID_ARGUMENT,
     {"trajectories[1].times_f64[1]", "ascending"},
     [](Request* r) {
       SetTimes(r, {1, 1, 2});
     }},
    {"time not a number",
     Code::INVALID_ARGUMENT,
     {"trajectories[1].times_f64[1]", "nan"},
     [](Request* r) {
       SetTimes(r, {0, NAN, 2});
     }},
    {"time before the stamp",
     Code::OUT_OF_RANGE,
     {"trajectories[1].times_f64[0]", "stamp 100000000", "before"},
     [](Request* r) {
       SetTimes(r, {-0.1, 1, 2});
     }},
    {"time beyond the horizon",
     Code::OUT_OF_RANGE,
     {"trajectories[1].times_f64[2]", "stamp 100000000", "limit 5"},
     [](Request* r) {
       SetTimes(r, {0, 1, 5.5});
     }},
    {"reference before the stamp",
     Code::OUT_OF_RANGE,
     {"stamp 100000000"},
     [](Request* r) { r->set_reference_ns(50'000'000); }},
    {"reference far out",
     Code::OUT_OF_RANGE,
     {"trajectories[0].times_f64[0]"},
     [](Request* r) { r->set_reference_ns(INT64_MIN); }},
    {"quaternion not of unit length",
     Code::INVALID_ARGUMENT,
     {"trajectories[0].waypoints_f64[1]"},
     [](Request* r) { SetPose(r, 6, 1.01); }},
    {"quaternion of zeros",
     Code::INVALID_ARGUMENT,
     {"trajectories[0].waypoints_f64[1]"},
     [](Request* r) { SetPose(r, 6, 0); }},
    {"position not a number",
     Code::INVALID_ARGUMENT,
     {"trajectories[0].waypoints_f64[1]"},
     [](Request* r) { SetPose(r, 0, NAN); }},
    {"position not finite",
     Code::INVALID_ARGUMENT,
     {"trajectories[0].waypoints_f64[1]"},
     [](Request* r) { SetPose(r, 2, INFINITY); }},
    {"a way without end",
     Code::INVALID_ARGUMENT,
     {"trajectories[0].waypoints[1]"},
     [](Request* r) { SetPose(r, 2, 1e300); }},
    {"a way too long",
     Code::INVALID_ARGUMENT,
     {"of way", "1e+06"},
     [](Request* r) { SetPose(r, 2, 9e8); }},
    {"no spheres",
     Code::INVALID_ARGUMENT,
     {"spheres_f32", "0", "1000"},
     [](Request* r) { r->clear_spheres_f32(); }},
    {"length of spheres",
     Code::INVALID_ARGUMENT,
     {"spheres_f32", "15", "16"},
     [](Request* r) { r->set_spheres_f32(std::string(15, 0)); }},
    {"thousands of spheres",
     Code::INVALID_ARGUMENT,
     {"spheres_f32", "5000", "1000"},
     [](Request* r) { r->set_spheres_f32(Bytes(std::vector<float>(5000 * 4, 1))); }},
    {"radius zero",
     Code::INVALID_ARGUMENT,
     {"spheres_f32[1]", "radius 0"},
     [](Request* r) {
       r->set_spheres_f32(Bytes(std::vector<float>{0, 0, 0, 1, 0, 0, 0, 0}));
     }},
    {"negative radius",
     Code::INVALID_ARGUMENT,
     {"spheres_f32[0]", "radius -1"},
     [](Request* r) {
       r->set_spheres_f32(Bytes(std::vector<float>{0, 0, 0, -1}));
     }},
    {"sphere not a number",
     Code::INVALID_ARGUMENT,
     {"spheres_f32[0]", "nan"},
     [](Request* r) {
       r->set_spheres_f32(Bytes(std::vector<float>{0, NAN, 0, 1}));
     }},
    {"too many waypoints",
     Code::INVALID_ARGUMENT,
     {"trajectories[0].waypoints_f64", "100000"},
     [](Request* r) { r->mutable_trajectories(0)->set_waypoints_f64(Poses(100'001)); }},
    {"too many trajectories",
     Code::INVALID_ARGUMENT,
     {"trajectories", "10001", "10000"},
     [](Request* r) {
       while (r->trajectories_size() < 10'001) *r->add_trajectories() = r->trajectories(0);
     }},
    {"too many states",
     Code::INVALID_ARGUMENT,
     {"spheres_f32", "1000 spheres", "2000000"},
     [](Request* r) {
       r->set_spheres_f32(Bytes(std::vector<float>(1000 * 4, 1)));
       r->mutable_trajectories(0)->set_waypoints_f64(Poses(2001, 1e-3));
       std::vector<double> times(2001);
       for (int i = 0; i < 2001; ++i) times[i] = i * 1e-3;
       r->mutable_trajectories(0)->set_times_f64(Bytes(times));
     }},
    {"negative margin",
     Code::INVALID_ARGUMENT,
     {"margin_m", "-1"},
     [](Request* r) { r->set_margin_m(-1); }},
    {"margin not a number",
     Code::INVALID_ARGUMENT,
     {"margin_m"},
     [](Request* r) { r->set_margin_m(NAN); }},
    {"negative sigma margin",
     Code::INVALID_ARGUMENT,
     {"sigma_margin"},
     [](Request* r) { r->set_sigma_margin(-1); }},
    {"unknown policy",
     Code::INVALID_ARGUMENT,
     {"unknown_policy", "9"},
     [](Request* r) { r->set_unknown_policy(static_cast<v1::UnknownPolicy>(9)); }},
    {"unknown object",
     Code::NOT_FOUND,
     {"7"},
     [](Request* r) { r->mutable_layers()->add_only_objects(7); }},
    {"unknown map", Code::NOT_FOUND, {"'yard'", "default"}, [](Request* r) { r->set_map("yard"); }},
    {"unknown pin",
     Code::NOT_FOUND,
     {"pin 3"},
     [](Request* r) { r->mutable_consistency()->set_pin_id(3); }},
    {"other epoch",
     Code::FAILED_PRECONDITION,
     {"epoch"},
     [](Request* r) { r->mutable_consistency()->set_epoch(1); }},
};

class CheckServiceTest : public ServiceFixture {
 protected:
  grpc::Status Check(const Request& request, v1::CheckTrajectoriesResponse* response) {
    grpc::ClientContext context;
    return query_->CheckTrajectories(&context, request, response);
  }
  grpc::Status Check(const v1::CheckSpheresRequest& request, v1::CheckSpheresResponse* response) {
    grpc::ClientContext context;
    return query_->CheckSpheres(&context, request, response);
  }
};

TEST_F(CheckServiceTest, EveryBadInputGetsItsCodeAndSaysWhatIsWrong) {
  StartServer();
  Ingest(ProtoFrame(1));
  v1::CheckTrajectoriesResponse response;
  ASSERT_TRUE(Check(Good(), &response).ok());
  for (const BadCheck& bad : kBadChecks) {
    SCOPED_TRACE(bad.name);
    Request request = Good();
    bad.spoil(&request);
    const grpc::Status status = Check(request, &response);
    EXPECT_EQ(status.error_code(), bad.code) << status.error_message();
    for (const std::string& part : bad.said) EXPECT_THAT(status.error_message(), HasSubstr(part));
  }
  EXPECT_EQ(Revision(), 1u);
}

TEST_F(CheckServiceTest, AnswersInTheTimesOfTheRequest) {
  StartServer();
  Ingest(ProtoFrame(1));
  Request request = Good();
  request.set_reference_ns(1'100'000'000);  // a second after the stamp
  v1::CheckTrajectoriesResponse response;
  ASSERT_TRUE(Check(request, &response).ok());
  EXPECT_EQ(response.reference_ns(), 1'100'000'000);
  EXPECT_EQ(response.stamp().revision(), 1u);
  ASSERT_EQ(response.results_size(), 2);
  EXPECT_FALSE(response.results(0).collides());
  EXPECT_NEAR(response.results(0).last_valid_s(), 2, 1e-9);
  EXPECT_EQ(response.results(0).last_valid_index(), 2u);
  EXPECT_NEAR(response.results(0).min_clearance_m(), 4.5, 1e-6);
  // By default what nobody saw is blocked.
  request.clear_unknown_policy();
  ASSERT_TRUE(Check(request, &response).ok());
  EXPECT_TRUE(response.results(1).collides());
  EXPECT_TRUE(response.results(1).unknown_decides());
  EXPECT_NEAR(response.results(1).first_collision_s(), 0, 1e-9);
  EXPECT_FALSE(response.results(1).has_last_valid_s());
  EXPECT_FALSE(response.results(1).has_last_valid_index());
}

TEST_F(CheckServiceTest, PosesTakeAnyOrderOfTimesOrNone) {
  StartServer();
  Ingest(ProtoFrame(1));
  v1::CheckSpheresRequest request;
  request.set_spheres_f32(Bytes(std::vector<float>{0, 0, 0, 0.5f, 1, 0, 0, 0.7f}));
  request.set_poses_f64(Poses(3));
  request.set_unknown_policy(v1::UNKNOWN_POLICY_AS_FREE);
  v1::CheckSpheresResponse response;
  ASSERT_TRUE(Check(request, &response).ok());
  EXPECT_EQ(Values<uint8_t>(response.collides_u8()), (std::vector<uint8_t>{0, 0, 0}));
  EXPECT_EQ(Values<uint32_t>(response.sphere_indices_u32()), (std::vector<uint32_t>{1, 1, 1}));
  for (const float clearance_m : Values<float>(response.clearances_f32())) {
    EXPECT_NEAR(clearance_m, 4.3f, 1e-5);
  }
  request.set_times_f64(Bytes(std::vector<double>{3, 0, 2}));
  EXPECT_TRUE(Check(request, &response).ok());
  const auto expect = [&](Code code, const char* said) {
    const grpc::Status status = Check(request, &response);
    EXPECT_EQ(status.error_code(), code) << status.error_message();
    EXPECT_THAT(status.error_message(), HasSubstr(said));
  };
  request.set_times_f64(Bytes(std::vector<double>{3, 0}));
  expect(Code::INVALID_ARGUMENT, "times_f64");
  request.set_times_f64(Bytes(std::vector<double>{3, -1, 0}));
  expect(Code::OUT_OF_RANGE, "times_f64[1]");
  request.set_times_f64(Bytes(std::vector<double>{3, 0, 7}));
  expect(Code::OUT_OF_RANGE, "times_f64[2]");
  request.clear_times_f64();
  request.clear_poses_f64();
  expect(Code::INVALID_ARGUMENT, "poses_f64");
  request.set_poses_f64(Poses(100'001));
  expect(Code::INVALID_ARGUMENT, "100001");
}

// Bytes flipped, cut and swapped: an answer or a clean refusal, and the server lives.
TEST_F(CheckServiceTest, SpoiledRequestsNeverHarmTheServer) {
  StartServer();
  Ingest(ProtoFrame(1));
  std::mt19937 rng(1);
  int refused = 0, answered = 0;
  for (int i = 0; i < 2000; ++i) {
    Request request = Good();
    std::string* const fields[] = {request.mutable_spheres_f32(),
                                   request.mutable_trajectories(0)->mutable_waypoints_f64(),
                                   request.mutable_trajectories(1)->mutable_times_f64()};
    for (int changes = 1 + rng() % 3; changes > 0; --changes) {
      std::string* field = fields[rng() % 3];
      switch (rng() % 4) {
        case 0:
          if (!field->empty()) (*field)[rng() % field->size()] ^= static_cast<char>(1 << rng() % 8);
          break;
        case 1:
          field->resize(rng() % (field->size() + 1));
          break;
        case 2:
          field->append(rng() % 64, static_cast<char>(rng()));
          break;
        default:
          for (char& byte : *field) byte = static_cast<char>(rng());
      }
    }
    v1::CheckTrajectoriesResponse response;
    const grpc::Status status = Check(request, &response);
    if (status.ok()) {
      ++answered;
      EXPECT_EQ(response.results_size(), 2);
    } else {
      ++refused;
      EXPECT_TRUE(status.error_code() == Code::INVALID_ARGUMENT ||
                  status.error_code() == Code::OUT_OF_RANGE)
          << status.error_message();
    }
  }
  EXPECT_GT(refused, 200);
  EXPECT_GT(answered, 20);
  EXPECT_EQ(Revision(), 1u);
}

}  // namespace
}  // namespace clearance
