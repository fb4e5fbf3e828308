//! The inverted hull: surfaces moved out along their normals, of which only what faces away is kept.
//!
//! The hull is the surface grown by a ball of the line's width, as far as triangles can say: smooth parts move
//! along the mean normal of all triangles that touch (vertices are welded by position, so that split normals open
//! no gaps), sharp convex edges and open borders get round strips, and corners the patches between these. So the
//! ring around a silhouette is as wide at a box's edge as on a ball, from every side.

mod builder;
mod fans;
mod grown;
mod line;
mod python;
mod round;

pub use python::*;
