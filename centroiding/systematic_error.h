// How far optics leave spots off any smooth field, as far as a frame shows it.
#pragma once

#include "centroiding/cell_sample.h"
#include "centroiding/slopes.h"
#include "core/centroids.h"
#include "core/slope_field.h"

namespace curlew {

/// Returns the part, in [0, 1], of the plan's systematic error that the cells of a frame show. It
/// is 0 while their circulation is spread as the noise of `slopes` says, and 1 where it is surely
/// spread wider, or where the sample is too small to tell. The spread is that of the median cell,
/// on which vortices have little effect: half of all cells lie within .6745 σ. The part grows from
/// 0 to 1 while the cells beyond that are 1.25 to 2.5 standard deviations of their number too many.
///
/// The variances of `slopes` must be those of noise. The sample must be of these slopes.
float systematic_part(const CellSample& sample, const SlopeField& slopes) noexcept;

/// Adds `part` times the plan's systematic error to the variances of every spot that has a slope:
/// .03 of the reference spot's σ, and .08 of what the spot is wider than that. It is no noise, for
/// it is the same in every frame. Slopes of lenslets without light keep their variance. All are
/// [rows, cols]. Never allocates.
void add_systematic_error(const SlopePlan& plan, const Centroids& centroids, float part,
                          SlopeField& slopes) noexcept;

}  // namespace curlew
