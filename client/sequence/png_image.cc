#include "client/sequence/png_image.h"

#include <png.h>

#include <csetjmp>
#include <cstring>
#include <string>

#include "absl/strings/str_format.h"
#include "client/sequence/text.h"

namespace clearance::client {
namespace {

constexpr uint64_t kMaxPixels = uint64_t{1} << 26;

struct Source {
  std::string_view bytes;
  size_t position = 0;
  char error[160] = "";
};

void Read(png_structp png, png_bytep out, png_size_t size) {
  auto* source = static_cast<Source*>(png_get_io_ptr(png));
  if (size > source->bytes.size() - source->position) png_error(png, "the file ends early");
  std::memcpy(out, source->bytes.data() + source->position, size);
  source->position += size;
}

void Fail(png_structp png, png_const_charp message) {
  auto* source = static_cast<Source*>(png_get_error_ptr(png));
  std::strncpy(source->error, message, sizeof(source->error) - 1);
  std::longjmp(png_jmpbuf(png), 1);
}

void Ignore(png_structp, png_const_charp) {}

// libpng leaves by longjmp: nothing between the setjmp and the last libpng call may own memory, so
// whatever does lives in the caller.
bool Decode(png_structp png, png_infop info, Source& source, Gray16Image& image,
            std::vector<png_bytep>& rows) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_read_fn(png, &source, Read);
  png_set_user_limits(png, 1 << 16, 1 << 16);
  png_read_info(png, info);
  image.width = png_get_image_width(png, info);
  image.height = png_get_image_height(png, info);
  if (png_get_color_type(png, info) != PNG_COLOR_TYPE_GRAY || png_get_bit_depth(png, info) < 8) {
    png_error(png, "not an 8 or 16 bit grey image");
  }
  if (uint64_t{image.width} * image.height > kMaxPixels) png_error(png, "too many pixels");
  if (png_get_bit_depth(png, info) == 8) png_set_expand_16(png);
  png_set_swap(png);  // PNG is big-endian
  png_read_update_info(png, info);
  image.pixels.resize(size_t{image.width} * image.height);
  rows.resize(image.height);
  for (size_t i = 0; i < rows.size(); ++i) {
    rows[i] = reinterpret_cast<png_bytep>(image.pixels.data() + i * image.width);
  }
  png_read_image(png, rows.data());
  png_read_end(png, nullptr);
  return true;
}

}  // namespace

absl::StatusOr<Gray16Image> ReadGray16Png(const std::filesystem::path& path) {
  const absl::StatusOr<std::string> bytes = ReadWholeFile(path);
  if (!bytes.ok()) return bytes.status();
  return ParseGray16Png(*bytes, path);
}

absl::StatusOr<Gray16Image> ParseGray16Png(std::string_view bytes,
                                           const std::filesystem::path& path) {
  Source source;
  source.bytes = bytes;
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &source, Fail, Ignore);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
  Gray16Image image;
  std::vector<png_bytep> rows;
  const bool ok = info != nullptr && Decode(png, info, source, image, rows);
  png_destroy_read_struct(&png, &info, nullptr);
  if (ok) return image;
  return absl::DataLossError(
      absl::StrFormat("%s: %s at byte %d of %d; expected a complete 16 bit grey PNG", path.string(),
                      source.error, source.position, bytes.size()));
}

}  // namespace clearance::client
