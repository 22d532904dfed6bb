// Which way of taking sites from the fused mean is the most exact.
#pragma once

namespace clearance::evaluation {

// Prints, for analytic solids in random poses on a 10 cm grid with exact and with noisy means, how
// far sites lie from the surface, how far the surface lies from its nearest site, and how distances
// to the sites differ from true ones: for the feet of voxel centres (what ExtractSites takes) and
// for the mean of the edge crossings about a voxel.
void PrintSiteCandidates();

}  // namespace clearance::evaluation
