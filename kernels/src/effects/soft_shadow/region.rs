//! Which texels can hide the light from a point: thesis section 5.3.2, for any rectangle and window.

use super::light::Seen;
use super::prepare::PreparedMap;

/// Columns `x0..x1` and rows `y0..y1` of a level of the map.
#[derive(Clone, Copy, Debug, Default)]
pub struct Region {
    pub level: usize,
    pub x0: i32,
    pub x1: i32,
    pub y0: i32,
    pub y1: i32,
    /// Occluders this region answers for: how far their rise is above the point's.
    pub above_from: f32,
    pub above_to: f32,
}

/// More than a map of 2^14 texels has.
pub const MOST_LEVELS: usize = 12;

/// Search regions on several levels, coarsest first.
#[derive(Clone, Copy, Debug, Default)]
pub struct Regions {
    list: [Region; MOST_LEVELS],
    count: usize,
}

impl Regions {
    pub fn as_slice(&self) -> &[Region] {
        &self.list[..self.count]
    }
}

/// A point's place in texels of level 0, the light's reach in texels per rise, and how far above the point
/// the nearest occluder may be.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    map: &'a PreparedMap,
    seen: &'a Seen,
    u: f64,
    v: f64,
    /// Left, right, bottom, top.
    reach: [f64; 4],
    above: f32,
}

impl<'a> Search<'a> {
    /// None: nothing can hide the light from the point. Starts with the map's own nearest depth, not with
    /// the near plane, which may be much closer; then takes the nearest depth inside, `refinements` times.
    pub fn new(map: &'a PreparedMap, seen: &'a Seen, refinements: usize) -> Option<Self> {
        let [texel_x, texel_y] = map.texel_size(0);
        let mut search = Search {
            map,
            seen,
            u: (seen.window_x - map.view.window[0]) / texel_x,
            v: (seen.window_y - map.view.window[2]) / texel_y,
            reach: [
                f64::from(seen.bounds[0]) / texel_x,
                f64::from(seen.bounds[1]) / texel_x,
                f64::from(seen.bounds[2]) / texel_y,
                f64::from(seen.bounds[3]) / texel_y,
            ],
            above: f32::INFINITY,
        };
        let mut nearest = map.nearest();
        for round in 0.. {
            let [rise, biased] = nearest;
            if biased <= seen.rise {
                return None;
            }
            search.above = search.above.min(rise - seen.rise);
            let region = search.around(search.above, 0)?;
            if round == refinements {
                break;
            }
            nearest = Self::nearest_in(map, [region.x0, region.x1, region.y0, region.y1]);
        }
        Some(search)
    }

    /// Whether the whole region lies within a slope.
    pub fn is_within(&self, slope: f64) -> bool {
        let [left, right, bottom, top] = self.seen.bounds.map(|side| f64::from(side * self.above));
        let (x, y) = (self.seen.window_x, self.seen.window_y);
        [x + left, x + right, y + bottom, y + top]
            .iter()
            .all(|side| side.abs() <= slope)
    }

    /// One region, on a level coarse enough for `max_samples` texels.
    pub fn whole(&self, max_samples: usize) -> Option<Region> {
        let mut level = 0;
        loop {
            let region = self.around(self.above, level)?;
            let texels = (region.x1 - region.x0) as usize * (region.y1 - region.y0) as usize;
            level += 1;
            if texels <= max_samples || level == self.map.levels.len() {
                return Some(region);
            }
        }
    }

    /// Thesis 5.3.3 strides over a search region with too many texels. Instead, every level answers for the
    /// occluders whose texels look about equally large from the point: far above it a coarse map shows
    /// as much as a fine one shows close to it. No level has many more than `max_samples` texels.
    pub fn bands(&self, max_samples: usize) -> Regions {
        let mut regions = Regions::default();
        let unit = unit(self.seen, max_samples, self.map);
        for level in (0..self.map.levels.len()).rev() {
            let (from, to) = band(level, self.map.levels.len());
            let (above_from, above_to) = (from * unit, to * unit);
            if self.above > above_from
                && let Some(region) = self.around(self.above.min(above_to), level)
            {
                regions.list[regions.count] = Region {
                    above_from,
                    above_to,
                    ..region
                };
                regions.count += 1;
            }
        }
        regions
    }

    /// Texels crossed by the pyramid from the point to the light, up to `above` the point: eq. 5.1.
    fn around(&self, above: f32, level: usize) -> Option<Region> {
        let size = &self.map.levels[level];
        let scale = 1.0 / (1u64 << level) as f64;
        let [left, right, bottom, top] = self.reach.map(|reach| reach * f64::from(above));
        let cut = |from: f64, to: f64, count: usize| {
            let (from, to, limit) = ((from * scale).floor(), (to * scale).floor() + 1.0, count as f64);
            (from.clamp(0.0, limit) as i32, to.clamp(0.0, limit) as i32)
        };
        let (x0, x1) = cut(self.u + left, self.u + right, size.width);
        let (y0, y1) = cut(self.v + bottom, self.v + top, size.height);
        let region = Region {
            level,
            x0,
            x1,
            y0,
            y1,
            above_from: 0.0,
            above_to: f32::INFINITY,
        };
        (x0 < x1 && y0 < y1).then_some(region)
    }

    /// Largest rise and biased rise in texels x0..x1, y0..y1 of level 0, from at most 2 x 2 of the pyramid's nodes.
    pub fn nearest_in(map: &PreparedMap, [x0, x1, y0, y1]: [i32; 4]) -> [f32; 2] {
        let width = (x1 - x0).max(y1 - y0) as u32;
        let level = (width.next_power_of_two().trailing_zeros() as usize).min(map.pyramid.len() - 1);
        let nodes = &map.pyramid[level];
        let mut nearest = [f32::NEG_INFINITY; 2];
        for y in y0 >> level..=(y1 - 1) >> level {
            for x in x0 >> level..=(x1 - 1) >> level {
                let node = nodes.nearest[y as usize * nodes.width + x as usize];
                nearest = [nearest[0].max(node[0]), nearest[1].max(node[1])];
            }
        }
        nearest
    }
}

/// The rise above a point at which the light covers `max_samples` texels of level 0.
pub fn unit(seen: &Seen, max_samples: usize, map: &PreparedMap) -> f32 {
    let [texel_x, texel_y] = map.texel_size(0);
    let [left, right, bottom, top] = seen.bounds.map(f64::from);
    (max_samples as f64 * texel_x * texel_y / ((right - left) * (top - bottom))).sqrt() as f32
}

/// From and to which rise above a point a level answers, in units of the point's own.
pub fn band(level: usize, levels: usize) -> (f32, f32) {
    let start = |level: usize| {
        if level == 0 {
            0.0
        } else {
            0.5 * (1u32 << level) as f32
        }
    };
    let end = if level + 1 == levels {
        f32::INFINITY
    } else {
        start(level + 1)
    };
    (start(level), end)
}
