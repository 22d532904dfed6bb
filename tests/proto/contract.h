// The contract as the build's descriptor set has it.
#pragma once

#include <google/protobuf/descriptor.h>

#include <functional>
#include <string>
#include <vector>

namespace clearance {

// The files of package clearance.v1. Owned for the life of the process.
const std::vector<const google::protobuf::FileDescriptor*>& ContractFiles();

// Calls fn for every message, nested ones included.
void ForEachMessage(const std::function<void(const google::protobuf::Descriptor&)>& fn);
void ForEachEnum(const std::function<void(const google::protobuf::EnumDescriptor&)>& fn);

// One line for every field, enum value and RPC: what a peer relies on.
std::vector<std::string> ContractLines();

}  // namespace clearance
