#include "tests/proto/contract.h"

#include <google/protobuf/descriptor.pb.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iostream>

#include "absl/strings/str_format.h"

namespace clearance {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::EnumDescriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::FileDescriptor;

void Visit(const Descriptor& message, const std::function<void(const Descriptor&)>& fn) {
  fn(message);
  for (int i = 0; i < message.nested_type_count(); ++i) Visit(*message.nested_type(i), fn);
}

std::string TypeOf(const FieldDescriptor& field) {
  std::string type = field.type_name();
  if (field.message_type() != nullptr) type = field.message_type()->full_name();
  if (field.enum_type() != nullptr) type = field.enum_type()->full_name();
  if (field.is_repeated()) type = "repeated " + type;
  if (field.has_optional_keyword()) type = "optional " + type;
  if (field.real_containing_oneof() != nullptr) {
    type = absl::StrFormat("oneof %s %s", field.real_containing_oneof()->name(), type);
  }
  return type;
}

std::string Streamed(bool stream, const Descriptor& message) {
  return (stream ? "stream " : "") + message.full_name();
}

}  // namespace

const std::vector<const FileDescriptor*>& ContractFiles() {
  static const auto* files = [] {
    google::protobuf::FileDescriptorSet set;
    std::ifstream in(CLEARANCE_DESCRIPTOR_SET, std::ios::binary);
    if (!set.ParseFromIstream(&in)) {
      std::cerr << "cannot read " << CLEARANCE_DESCRIPTOR_SET << "\n";
      std::abort();
    }
    auto* pool = new google::protobuf::DescriptorPool();
    auto* result = new std::vector<const FileDescriptor*>();
    for (const auto& file : set.file()) {
      const FileDescriptor* built = pool->BuildFile(file);
      if (built != nullptr && built->package() == "clearance.v1") result->push_back(built);
    }
    return result;
  }();
  return *files;
}

void ForEachMessage(const std::function<void(const Descriptor&)>& fn) {
  for (const FileDescriptor* file : ContractFiles()) {
    for (int i = 0; i < file->message_type_count(); ++i) Visit(*file->message_type(i), fn);
  }
}

void ForEachEnum(const std::function<void(const EnumDescriptor&)>& fn) {
  for (const FileDescriptor* file : ContractFiles()) {
    for (int i = 0; i < file->enum_type_count(); ++i) fn(*file->enum_type(i));
  }
  ForEachMessage([&](const Descriptor& message) {
    for (int i = 0; i < message.enum_type_count(); ++i) fn(*message.enum_type(i));
  });
}

std::vector<std::string> ContractLines() {
  std::vector<std::string> lines;
  ForEachMessage([&](const Descriptor& message) {
    for (int i = 0; i < message.field_count(); ++i) {
      const FieldDescriptor& f = *message.field(i);
      lines.push_back(absl::StrFormat("%s = %d: %s", f.full_name(), f.number(), TypeOf(f)));
    }
  });
  ForEachEnum([&](const EnumDescriptor& e) {
    for (int i = 0; i < e.value_count(); ++i) {
      lines.push_back(absl::StrFormat("enum %s.%s = %d", e.full_name(), e.value(i)->name(),
                                      e.value(i)->number()));
    }
  });
  for (const FileDescriptor* file : ContractFiles()) {
    for (int i = 0; i < file->service_count(); ++i) {
      for (int j = 0; j < file->service(i)->method_count(); ++j) {
        const auto& m = *file->service(i)->method(j);
        lines.push_back(absl::StrFormat("rpc %s(%s) returns (%s)", m.full_name(),
                                        Streamed(m.client_streaming(), *m.input_type()),
                                        Streamed(m.server_streaming(), *m.output_type())));
      }
    }
  }
  std::sort(lines.begin(), lines.end());
  return lines;
}

}  // namespace clearance
