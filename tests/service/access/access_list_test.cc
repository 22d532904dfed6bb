#include "server/service/access/access_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace clearance {
namespace {

using ::testing::HasSubstr;

constexpr char kGood[] = R"(callers:
  - name: planner
    token_sha256: 2bb80d537b1da3e38bd30361aa855686bde0eacd7162fef6a25fe97bf527a25b
    maps: {yard: [read], "*": [ingest]}
  - name: robot
    certificate: robot-7
    maps:
      yard: [read, admin]
)";

TEST(AccessList, HashesAsTheStandardSays) {
  // FIPS 180-2's example.
  EXPECT_EQ(Sha256Hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(AccessList, FindsCallersByTokenAndByCertificate) {
  const auto list = AccessList::Parse(kGood, "access.yaml");
  ASSERT_TRUE(list.ok()) << list.status();
  EXPECT_EQ(list->size(), 2u);
  const Caller* planner = list->ByToken("secret");  // SHA-256 of "secret" stands above
  ASSERT_NE(planner, nullptr);
  EXPECT_EQ(planner->name, "planner");
  EXPECT_EQ(list->ByToken("Secret"), nullptr);
  EXPECT_EQ(list->ByToken(""), nullptr);
  const Caller* robot = list->ByCertificate({"somebody", "robot-7"});
  ASSERT_NE(robot, nullptr);
  EXPECT_EQ(robot->name, "robot");
  EXPECT_EQ(list->ByCertificate({"robot-70"}), nullptr);
  EXPECT_EQ(list->ByCertificate({}), nullptr);
}

TEST(AccessList, GivesOnlyTheRightsThatAreListed) {
  const auto list = AccessList::Parse(kGood, "access.yaml");
  ASSERT_TRUE(list.ok());
  const Caller& planner = *list->ByToken("secret");
  EXPECT_TRUE(planner.May(Right::kRead, "yard"));
  EXPECT_FALSE(planner.May(Right::kRead, "hall"));
  EXPECT_TRUE(planner.May(Right::kIngest, "yard"));
  EXPECT_TRUE(planner.May(Right::kIngest, "hall"));
  EXPECT_FALSE(planner.May(Right::kAdmin, "yard"));
  EXPECT_FALSE(planner.MayEverywhere(Right::kRead));
  EXPECT_TRUE(planner.MayEverywhere(Right::kIngest));
  EXPECT_TRUE(planner.MaySomewhere(Right::kRead));
  EXPECT_FALSE(planner.MaySomewhere(Right::kAdmin));
  const Caller& robot = *list->ByCertificate({"robot-7"});
  EXPECT_TRUE(robot.May(Right::kAdmin, "yard"));
  EXPECT_FALSE(robot.May(Right::kIngest, "yard"));
}

TEST(AccessList, SaysWhatIsWrongAndWhere) {
  const std::string hash(64, 'a');
  const struct {
    std::string yaml, expected;
  } cases[] = {
      {"", "expected one key, callers"},
      {"callers: 3", "expected one key, callers"},
      {"callers: []\nother: 1", "expected one key, callers"},
      {"callers:\n  - 7", "f:2: callers: expected name"},
      {"callers:\n  - maps: {yard: [read]}\n    certificate: a", "f:2: a caller without name"},
      {"callers:\n  - name: a\n    certificate: a", "a caller without maps"},
      {"callers:\n  - name: a\n    maps: {yard: [read]}", "without token_sha256 or certificate"},
      {"callers:\n  - name: a\n    token: x\n    maps: {yard: [read]}", "f:3: unknown key 'token'"},
      {"callers:\n  - name: a\n    token_sha256: abc\n    maps: {yard: [read]}", "64 hexadecimal"},
      {"callers:\n  - name: a\n    token_sha256: " + std::string(64, 'g') +
           "\n    maps: {y: [read]}",
       "64 hexadecimal"},
      {"callers:\n  - name: a\n    certificate: a\n    maps: {yard: [write]}", "got 'write'"},
      {"callers:\n  - name: a\n    certificate: a\n    maps: {yard: []}", "a list of read"},
      {"callers:\n  - name: a\n    certificate: a\n    maps: {Yard: [read]}", "got 'Yard'"},
      {"callers:\n  - name: a\n    token_sha256: " + hash +
           "\n    maps: {y: [read]}\n  - name: b\n    token_sha256: " + hash +
           "\n    maps: {y: [read]}",
       "two callers with one token"},
      {"callers: [", "f:"},
  };
  for (const auto& c : cases) {
    const auto list = AccessList::Parse(c.yaml, "f");
    EXPECT_EQ(list.status().code(), absl::StatusCode::kInvalidArgument) << c.yaml;
    EXPECT_THAT(std::string(list.status().message()), HasSubstr(c.expected)) << c.yaml;
  }
}

TEST(AccessList, MissingFileIsNotFound) {
  EXPECT_EQ(AccessList::Load("/nowhere/access.yaml").status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace clearance
