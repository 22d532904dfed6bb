#include <png.h>

#include <cerrno>
#include <csetjmp>
#include <cstdio>
#include <cstring>

#include "absl/strings/str_format.h"
#include "client/draw/canvas.h"

namespace clearance::client {
namespace {

void Fail(png_structp png, png_const_charp) { std::longjmp(png_jmpbuf(png), 1); }
void Ignore(png_structp, png_const_charp) {}

// libpng leaves by longjmp: nothing here owns memory.
bool Encode(png_structp png, png_infop info, std::FILE* file, const Color* pixels, int width,
            int height) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_init_io(png, file);
  png_set_IHDR(png, info, width, height, 8, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  for (int y = 0; y < height; ++y) {
    png_write_row(png, reinterpret_cast<png_const_bytep>(pixels + static_cast<size_t>(y) * width));
  }
  png_write_end(png, nullptr);
  return true;
}

}  // namespace

static_assert(sizeof(Color) == 3);

absl::Status Canvas::WritePng(const std::filesystem::path& path) const {
  errno = 0;
  std::FILE* file = std::fopen(path.c_str(), "wb");
  bool ok = file != nullptr;
  if (ok) {
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, Fail, Ignore);
    png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
    ok = info != nullptr && Encode(png, info, file, pixels_.data(), width_, height_);
    png_destroy_write_struct(&png, &info);
    ok = std::fclose(file) == 0 && ok;
  }
  if (ok) return absl::OkStatus();
  return absl::NotFoundError(absl::StrFormat("%s: cannot be written (%s); choose another --out",
                                             path.string(), std::strerror(errno)));
}

}  // namespace clearance::client
