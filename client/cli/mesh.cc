// mesh and grid: files from the server.
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iostream>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/cli/context.h"
#include "client/cli/print.h"

namespace clearance::cli {
namespace {

struct MeshArguments {
  std::string out;
  std::optional<uint32_t> object_id;
  bool object_frame = false;
};

struct GridArguments {
  std::string out;
  std::optional<uint32_t> object_id;
  std::vector<std::string> kinds;
};

// Writes aside and renames: a broken transfer leaves no half file.
class FileInTheMaking {
 public:
  explicit FileInTheMaking(std::string path)
      : path_(std::move(path)), partial_(path_ + ".part"), out_(partial_, std::ios::binary) {}
  ~FileInTheMaking() {
    if (!done_) std::remove(partial_.c_str());
  }

  absl::Status Append(std::string_view bytes) {
    out_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    return out_ ? absl::OkStatus() : Failed();
  }

  absl::Status Commit() {
    out_.close();
    done_ = out_ && std::rename(partial_.c_str(), path_.c_str()) == 0;
    return done_ ? absl::OkStatus() : Failed();
  }

 private:
  absl::Status Failed() const {
    return absl::NotFoundError(absl::StrFormat("%s: cannot be written (%s); choose another --out",
                                               path_, std::strerror(errno)));
  }

  const std::string path_, partial_;
  std::ofstream out_;
  bool done_ = false;
};

void Report(const Context& context, const std::string& path, const client::ExportResult& result,
            bool mesh) {
  if (context.json) {
    Json json = {{"file", path}, {"bytes", result.bytes}, {"stamp", ToJson(result.stamp)}};
    if (mesh) json["vertices"] = result.vertices;
    if (mesh) json["triangles"] = result.triangles;
    PrintJson(json);
    return;
  }
  std::cout << path << ": ";
  if (mesh) {
    std::cout << absl::StrFormat("%d vertices, %d triangles, ", result.vertices, result.triangles);
  }
  std::cout << absl::StrFormat("%s, revision %d\n", Bytes(result.bytes), result.stamp.revision);
}

absl::Status Mesh(const Context& context, const MeshArguments& arguments) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  client::MeshOptions options;
  options.object_id = arguments.object_id;
  options.object_frame = arguments.object_frame;
  options.glb = absl::EndsWithIgnoreCase(arguments.out, ".glb");
  FileInTheMaking file(arguments.out);
  const auto result =
      (*client)->ExportMesh(options, [&](std::string_view bytes) { return file.Append(bytes); });
  if (!result.ok()) return result.status();
  if (absl::Status s = file.Commit(); !s.ok()) return s;
  Report(context, arguments.out, *result, /*mesh=*/true);
  return absl::OkStatus();
}

absl::Status Grid(const Context& context, const GridArguments& arguments) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  client::GridOptions options;
  options.object_id = arguments.object_id;
  for (const std::string& kind : arguments.kinds) {
    options.kinds.push_back(kind == "mean"     ? client::GridKind::kMean
                            : kind == "weight" ? client::GridKind::kWeight
                            : kind == "free"   ? client::GridKind::kFreeSpace
                                               : client::GridKind::kDistance);
  }
  FileInTheMaking file(arguments.out);
  const auto result =
      (*client)->ExportGrid(options, [&](std::string_view bytes) { return file.Append(bytes); });
  if (!result.ok()) return result.status();
  if (absl::Status s = file.Commit(); !s.ok()) return s;
  Report(context, arguments.out, *result, /*mesh=*/false);
  return absl::OkStatus();
}

}  // namespace

void AddMesh(CLI::App& app, Context& context) {
  auto arguments = std::make_shared<MeshArguments>();
  CLI::App* command =
      AddCommand(app, context, "mesh", "the surface of the static map or of an object as a file",
                 [&context, arguments] { return Mesh(context, *arguments); });
  command->add_option("--out", arguments->out, "FILE.ply or FILE.glb")
      ->required()
      ->check([](const std::string& path) {
        const bool known =
            absl::EndsWithIgnoreCase(path, ".ply") || absl::EndsWithIgnoreCase(path, ".glb");
        return known ? std::string() : "got " + path + ", expected a name ending in .ply or .glb";
      });
  auto* object = command->add_option("--object", arguments->object_id, "an object's id");
  command
      ->add_flag("--object-frame", arguments->object_frame,
                 "in the object's own frame instead of the world")
      ->needs(object);
}

void AddGrid(CLI::App& app, Context& context) {
  auto arguments = std::make_shared<GridArguments>();
  CLI::App* command = AddCommand(app, context, "grid", "grids as an OpenVDB file",
                                 [&context, arguments] { return Grid(context, *arguments); });
  command->add_option("--out", arguments->out, "FILE.vdb")->required();
  command->add_option("--object", arguments->object_id, "an object's id");
  command->add_option("--kind", arguments->kinds, "mean, weight, free, distance; repeatable")
      ->check(CLI::IsMember({"mean", "weight", "free", "distance"}));
}

}  // namespace clearance::cli
