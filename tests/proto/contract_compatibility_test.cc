// Fields are added, never renamed, renumbered, retyped or removed.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iterator>

#include "absl/strings/str_join.h"
#include "tests/proto/contract.h"

namespace clearance {
namespace {

std::vector<std::string> Golden() {
  std::vector<std::string> lines;
  std::ifstream in(CLEARANCE_CONTRACT_GOLDEN);
  for (std::string line; std::getline(in, line);) {
    if (!line.empty()) lines.push_back(line);
  }
  std::sort(lines.begin(), lines.end());
  return lines;
}

std::vector<std::string> Minus(const std::vector<std::string>& a,
                               const std::vector<std::string>& b) {
  std::vector<std::string> difference;
  std::set_difference(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(difference));
  return difference;
}

TEST(Contract, KeepsEveryFieldEnumValueAndRpcItEverHad) {
  ASSERT_GT(Golden().size(), 100u);
  const auto gone = Minus(Golden(), ContractLines());
  EXPECT_TRUE(gone.empty()) << "clients rely on:\n" << absl::StrJoin(gone, "\n");
}

TEST(Contract, GuardsEveryAddition) {
  const auto added = Minus(ContractLines(), Golden());
  EXPECT_TRUE(added.empty()) << "add to " << CLEARANCE_CONTRACT_GOLDEN << ":\n"
                             << absl::StrJoin(added, "\n");
}

}  // namespace
}  // namespace clearance
