#include "planner_demo/sequence/image_file.h"

#include <absl/strings/str_cat.h>
#include <png.h>

#include <cerrno>
#include <csetjmp>
#include <cstdio>
#include <cstring>

namespace clearance::sim {
namespace {

// libpng reports errors by longjmp, so nothing with a destructor may live in here.
bool Encode(FILE* file, png_structp png, png_infop info, int width, int height,
            const uint16_t* pixels) {
  if (setjmp(png_jmpbuf(png))) return false;
  png_init_io(png, file);
  png_set_compression_level(png, 2);
  png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_UP);
  png_set_IHDR(png, info, width, height, 16, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  png_set_swap(png);  // PNG is big endian
  for (int row = 0; row < height; ++row) {
    png_write_row(png,
                  reinterpret_cast<png_const_bytep>(pixels + static_cast<size_t>(row) * width));
  }
  png_write_end(png, info);
  return true;
}

}  // namespace

absl::Status WritePng16(const std::string& path, int width, int height,
                        const std::vector<uint16_t>& pixels) {
  if (pixels.size() != static_cast<size_t>(width) * height) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": got ", pixels.size(), " pixels, expected ", width, " x ", height));
  }
  FILE* file = std::fopen(path.c_str(), "wb");
  if (file == nullptr) {
    return absl::UnavailableError(absl::StrCat("cannot write ", path, ": ", std::strerror(errno)));
  }
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  const bool encoded = info != nullptr && Encode(file, png, info, width, height, pixels.data());
  png_destroy_write_struct(&png, &info);
  const bool closed = std::fclose(file) == 0;
  if (encoded && closed) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat("cannot write ", path, ": the disk may be full"));
}

}  // namespace clearance::sim
