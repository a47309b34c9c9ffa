// A Dissection is the order in which the nodes of a pupil are eliminated, and what follows from it
// whatever the weights are: nested dissection of the two sublattices.
//
// A sublattice is a square lattice, turned by 45°. Its coordinates are u and v, with row = u − v +
// parity and column = u + v, so that edge A of a lenslet runs along u and edge B along v. Lines of
// constant u or v, TileShape::kSide apart, cut it into tiles. The nodes inside a tile touch nothing
// but the tile's border, so that the tiles come first, each for itself. Then lines join the tiles
// by twos, fours and so on (A. George, SIAM J. Numer. Anal. 10, 345, 1973).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "core/as_size.h"
#include "core/lattice.h"

namespace curlew {

/// A tile holds the nodes inside it, numbered in the order in which they are eliminated, and after
/// them those of its border. A corner of the tile touches nothing inside and is no part of it.
struct TileShape {
  static constexpr int kSide = 8;
  static constexpr int kInside = (kSide - 1) * (kSide - 1);
  static constexpr int kBorder = 4 * (kSide - 1);
  static constexpr int kNodes = kInside + kBorder;

  /// This is a place in units of the sublattice, counted from the crossing of the first two lines.
  struct Place {
    int u;
    int v;
  };
  /// This is an edge with an end inside, between node `from` and the later node `to`.
  struct Edge {
    int from;
    int to;
    Place start;   ///< the end with the smaller u or v
    bool along_u;  ///< whether it is edge A of its lenslet
  };
  TileShape();

  std::array<Place, kNodes> place;
  std::vector<Edge> edges;
  /// later[i] holds the nodes that node i touches when its turn comes, ascending.
  std::array<std::vector<int>, kInside> later;
};

/// This is a set of nodes that are eliminated together: those inside one tile, or those on a line
/// between tiles. Nodes are given by their positions in the order of elimination.
struct Front {
  std::int32_t first = 0;            ///< position of its first node
  std::int32_t pivots = 0;           ///< number of its nodes
  std::vector<std::int32_t> border;  ///< later nodes that it touches when its turn comes, ascending
  std::int32_t parent = -1;          ///< the front of the border's first node; −1: no border
  std::int32_t tile = -1;            ///< the index of its tile; −1: its nodes are on a line

  std::int32_t rows() const { return pivots + static_cast<std::int32_t>(border.size()); }
  /// Returns the row of a position, which must be among the front's nodes or its border.
  std::int32_t row_of(std::int32_t position) const;
};

class Dissection {
 public:
  struct Tile {
    int parity;  ///< of the sublattice
    int u;       ///< of its first lines
    int v;
  };
  /// This is an edge as seen from node `from`: the node at its other end, and its lenslet.
  struct Link {
    std::int32_t from;
    std::int32_t to;
    std::int32_t lenslet;
  };

  explicit Dissection(const Lattice& lattice);

  int n_nodes() const { return static_cast<int>(corner_.size()); }
  /// Returns the corner whose node is eliminated at this position.
  int corner_at(int position) const { return corner_[as_size(position)]; }
  /// Returns the position of the node at (u, v), and n_nodes() where there is none.
  int position_of(int parity, int u, int v) const;
  /// Returns the lenslet of the edge that starts at (u, v), and −1 where there is none.
  int lenslet_of(int parity, int u, int v, bool along_u) const;

  const TileShape& shape() const { return shape_; }
  const std::vector<Tile>& tiles() const { return tiles_; }
  const std::vector<Front>& fronts() const { return fronts_; }  ///< in the order of elimination
  /// Returns the front of every position.
  const std::vector<std::int32_t>& front_of() const { return front_of_; }
  /// Returns every edge of the lattice, as seen from its earlier end.
  const std::vector<Link>& links() const { return links_; }

 private:
  /// This is a rectangle of a sublattice, without its last u and v.
  struct Box {
    int first_u, last_u, first_v, last_v;
  };
  void dissect_sublattice(int parity);
  void dissect(int parity, const Box& inside);
  void add_tile(int parity, const Box& inside);
  void add_line(int parity, const Box& line);
  void add_node(int corner);
  void finish_front(std::int32_t tile);
  bool any_node(int parity, const Box& box) const;
  void find_links();
  void find_borders();
  int corner_of(int parity, int u, int v) const;

  int rows_;
  int cols_;
  TileShape shape_;
  std::vector<int> position_;  // [corners] n_nodes() where no node is; −1 while not yet placed
  std::vector<int> corner_;
  std::vector<std::uint8_t> lit_;  // [lenslets]
  std::vector<Tile> tiles_;
  std::vector<Front> fronts_;
  std::vector<std::int32_t> front_of_;
  std::vector<Link> links_;
};

}  // namespace curlew
