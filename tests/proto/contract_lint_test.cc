// The standard rules for protobuf contracts, checked on the descriptor set.
#include <gtest/gtest.h>

#include <cctype>
#include <map>
#include <set>
#include <string>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "tests/proto/contract.h"

namespace clearance {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::EnumDescriptor;
using google::protobuf::FileDescriptor;

bool IsLowerSnake(const std::string& s) {
  if (s.empty() || !std::islower(s[0]) || s.back() == '_' || absl::StrContains(s, "__"))
    return false;
  for (const char c : s) {
    if (!std::islower(c) && !std::isdigit(c) && c != '_') return false;
  }
  return true;
}

bool IsPascal(const std::string& s) {
  if (s.empty() || !std::isupper(s[0])) return false;
  for (const char c : s) {
    if (!std::isalnum(c)) return false;
  }
  return true;
}

std::string UpperSnake(const std::string& pascal) {
  std::string result;
  for (const char c : pascal) {
    if (std::isupper(c) && !result.empty()) result += '_';
    result += static_cast<char>(std::toupper(c));
  }
  return result;
}

void ForEachMethod(const std::function<void(const google::protobuf::MethodDescriptor&)>& fn) {
  for (const FileDescriptor* file : ContractFiles()) {
    for (int i = 0; i < file->service_count(); ++i) {
      for (int j = 0; j < file->service(i)->method_count(); ++j) fn(*file->service(i)->method(j));
    }
  }
}

TEST(ContractLint, HasAllServicesAndFilesLieInTheirPackageFolder) {
  std::set<std::string> services;
  for (const FileDescriptor* file : ContractFiles()) {
    EXPECT_TRUE(absl::StartsWith(file->name(), "clearance/v1/")) << file->name();
    EXPECT_EQ(file->syntax(), FileDescriptor::SYNTAX_PROTO3) << file->name();
    for (int i = 0; i < file->service_count(); ++i) services.insert(file->service(i)->name());
  }
  EXPECT_EQ(services,
            (std::set<std::string>{"AdminService", "ExportService", "IngestService", "MapService",
                                   "QueryService", "SnapshotService", "WatchService"}));
}

TEST(ContractLint, ServicesEndInServiceAndRpcsArePascalCase) {
  ForEachMethod([](const auto& method) {
    EXPECT_TRUE(absl::EndsWith(method.service()->name(), "Service")) << method.full_name();
    EXPECT_TRUE(IsPascal(method.name())) << method.full_name();
  });
}

TEST(ContractLint, EveryRpcHasItsOwnRequestAndResponse) {
  std::map<std::string, std::string> used;
  ForEachMethod([&](const auto& method) {
    EXPECT_EQ(method.input_type()->name(), method.name() + "Request");
    EXPECT_EQ(method.output_type()->name(), method.name() + "Response");
    for (const Descriptor* message : {method.input_type(), method.output_type()}) {
      const auto [entry, fresh] = used.emplace(message->full_name(), method.full_name());
      EXPECT_TRUE(fresh) << message->full_name() << " in " << entry->second << " and "
                         << method.full_name();
    }
  });
}

TEST(ContractLint, FieldsAreLowerSnakeCaseAndMessagesPascalCase) {
  int fields = 0;
  ForEachMessage([&](const Descriptor& message) {
    EXPECT_TRUE(IsPascal(message.name())) << message.full_name();
    for (int i = 0; i < message.field_count(); ++i, ++fields) {
      EXPECT_TRUE(IsLowerSnake(message.field(i)->name())) << message.field(i)->full_name();
    }
    for (int i = 0; i < message.oneof_decl_count(); ++i) {
      const auto* oneof = message.oneof_decl(i);
      EXPECT_TRUE(oneof->is_synthetic() || IsLowerSnake(oneof->name())) << oneof->full_name();
    }
  });
  EXPECT_GT(fields, 200);
}

TEST(ContractLint, EnumValuesCarryTheEnumsNameAndZeroIsUnspecified) {
  int enums = 0;
  ForEachEnum([&](const EnumDescriptor& e) {
    ++enums;
    const std::string prefix = UpperSnake(e.name()) + "_";
    ASSERT_NE(e.FindValueByNumber(0), nullptr) << e.full_name();
    EXPECT_EQ(e.FindValueByNumber(0)->name(), prefix + "UNSPECIFIED");
    for (int i = 0; i < e.value_count(); ++i) {
      EXPECT_TRUE(absl::StartsWith(e.value(i)->name(), prefix)) << e.value(i)->full_name();
    }
  });
  EXPECT_GE(enums, 8);
}

TEST(ContractLint, BulkArraysNameTheirElementAndScalarsTheirUnit) {
  const std::set<std::string> elements = {"f32", "f64", "u8", "u16", "u32", "i32", "i64"};
  const std::set<std::string> opaque = {"data", "payload"};
  ForEachMessage([&](const Descriptor& message) {
    for (int i = 0; i < message.field_count(); ++i) {
      const auto& field = *message.field(i);
      if (field.type() != google::protobuf::FieldDescriptor::TYPE_BYTES) continue;
      const std::string suffix = field.name().substr(field.name().rfind('_') + 1);
      EXPECT_TRUE(elements.contains(suffix) || opaque.contains(field.name())) << field.full_name();
    }
  });
}

TEST(ContractLint, EveryReplyOfAMapCarriesItsStamp) {
  // What is not of one map, or carries the stamp one level deeper (in each oneof member or entry).
  const std::set<std::string> exempt = {"IngestFrames",  "IngestFrame", "QueryStream",
                                        "CreateMap",     "GetMap",      "ListMaps",
                                        "GetServerInfo", "GetStats",    "Drain"};
  ForEachMethod([&](const auto& method) {
    if (exempt.contains(method.name())) return;
    EXPECT_NE(method.output_type()->FindFieldByName("stamp"), nullptr) << method.full_name();
  });
}

}  // namespace
}  // namespace clearance
