// A 5x7 dot font for ASCII.
#pragma once

#include <array>
#include <cstdint>

namespace clearance::client {

inline constexpr int kGlyphWidth = 5;
inline constexpr int kGlyphHeight = 7;

// One byte a row, the leftmost dot is bit 4.
using Glyph = std::array<uint8_t, kGlyphHeight>;

// '?' for characters without a glyph. Covers ' ' to '~'.
const Glyph& GlyphOf(char c);

}  // namespace clearance::client
