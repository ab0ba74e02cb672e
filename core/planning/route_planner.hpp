// Cost-aware A* on a window of log-odds, eq 22: Cost = Cost_dist + Cost_obs + lambda Cost_kin.
#pragma once

#include <cstdint>
#include <vector>

#include "planning/astar.hpp"
#include "planning/bucket_queue.hpp"

namespace adrl {

// All lengths in metres. The density of a place is k_obstacle O + k_goal (1 - T_goal) + k_turn rho, in [0, 1] when the
// three sum to 1: O falls from 1 at the inflation to 0 at `comfort` beyond it, T_goal rises from 0 at near_goal to 1 at
// the goal, rho is the change of heading of a move over pi.
struct RouteCosts {
    double inflation = 0.25; // clearance the robot's centre needs
    double comfort = 0.3;
    double near_goal = 3.0;
    double weight = 1.0; // metres that a metre at density 1 costs more: Cost_obs = weight * integral of density
    double k_obstacle = 0.6;
    double k_goal = 0.1;
    double k_turn = 0.3;
    double turn = 0.1;     // lambda: metres that a radian of turning costs
    bool headings = false; // heading in the state: Cost_kin and rho are part of the search. Otherwise both are left out
    bool operator==(const RouteCosts &) const = default;
};

struct Route {
    const std::vector<Cell> *cells; // start and end included; empty when no cell but the start can be reached
    double cost;                    // metres of eq 22
    bool reached; // it ends in the goal's cell; otherwise at the border, or in the reachable cell nearest to the goal
    bool through; // all else is shut off: what is solid but no wall counted as free
};

// Plans on windows of one size. Owns its scratch; a plan allocates nothing.
class RoutePlanner {
  public:
    // One whole-number unit of cost is a 64th of a cell, and every move is rounded up to units.
    static constexpr int kUnit = 64;
    // Cells that inflation and comfort may sum to: twice its square is the most that 16 bits hold.
    static constexpr int kMaxReach = 181;
    // Most that weight and turn may be: 16 bits hold the cost of a cell, 32 that of any route through 400 x 400 cells.
    static constexpr double kMaxWeight = 100.0;
    static constexpr double kMaxTurn = 10.0;

    RoutePlanner(int height, int width, double resolution, const RouteCosts &costs);

    // Plans with other clearances from now on, inflation and comfort; all else as the planner was made for. Allocates
    // nothing where they sum to no more than those it was made for.
    void use(const RouteCosts &costs);

    // log_odds (height x width) and wall: as in Evidence. The route to a goal outside of the window, or one that is
    // shut off within it, ends in the border cell from which the octile rest of the way is least in all. Where the
    // border is shut off too, walls alone count as solid. Where that does not help either, or a cell within 0.3 m of
    // the goal can be reached, it ends in the reachable cell nearest to the goal. heading: of the robot, radians,
    // counted with `headings` only. The start counts as free, and around it as much clearance is asked for as it has.
    Route plan(const std::int8_t *log_odds, std::int8_t wall, Cell start, Cell goal, double heading);

    // Of the last plan:
    // cost from each cell of the route to its end, metres
    const std::vector<double> &cost_to_go() const { return to_go_; }
    // whether a cell has the clearance asked for, and its O
    bool is_free(int row, int column) const {
        return row >= 0 && column >= 0 && row < height_ && column < width_ && level_[index(row, column)] != 0;
    }
    double obstacle_density(int row, int column) const;
    // out (H, W): metres from cells' centres to the nearest one's that counted as solid; those beyond inflation and
    // comfort are far
    void clearances(float *out) const;
    int height() const { return height_; }
    int width() const { return width_; }

  private:
    struct Run {
        int row, first, last, parent;
    };

    std::size_t index(int row, int column) const { return static_cast<std::size_t>(row + 1) * stride_ + column + 1; }
    bool in_window(Cell c) const { return c.row >= 0 && c.column >= 0 && c.row < height_ && c.column < width_; }
    bool is_end(std::size_t cell) const { return leaves_ ? on_border(cell_at(cell)) : cell == target_cell_; }
    bool on_border(Cell c) const {
        return c.row == 0 || c.column == 0 || c.row == height_ - 1 || c.column == width_ - 1;
    }
    void level();
    // Finds what is free, and where a route is to end. solid: the least that a cell holds which is not passed. Returns
    // whether the border, or a cell within 0.3 m of the goal, can be reached.
    bool survey(const std::int8_t *log_odds, std::int8_t solid, Cell start, Cell goal);
    void measure(const std::int8_t *log_odds, std::int8_t solid);
    void free_around(Cell start);
    bool aim(Cell start, Cell goal); // returns what survey does
    int root(int run);
    void prepare(int row);
    void prepare_beside(std::size_t cell);
    Cell cell_at(std::size_t cell) const {
        const auto i = static_cast<std::uint32_t>(cell);
        const auto stride = static_cast<std::uint32_t>(stride_);
        return {static_cast<int>(i / stride) - 1, static_cast<int>(i % stride) - 1};
    }
    std::uint32_t search(std::size_t start);
    std::uint32_t search_headings(std::size_t start, double heading);
    void expand(std::size_t cell, int heading, std::uint32_t g, bool first);
    // Units to the cell on the cheapest way, turned there to a heading.
    std::uint32_t turned_to(std::size_t cell, int heading) const;
    void trace(std::size_t start);
    void trace_headings(std::size_t start);

    int height_, width_, stride_; // stride of the padded arrays: a border of blocked cells spares the range checks
    double resolution_;
    RouteCosts costs_;
    double near_; // near_goal in units
    double inverse_near_;
    int limit_;                                   // cells up to which clearance is measured
    std::uint32_t turn_straight_, turn_diagonal_; // units an eighth of a turn costs
    std::vector<std::uint8_t> level_of_;          // by squared clearance
    std::vector<double> density_of_, price_of_;   // by level: O, and k_obstacle O
    std::vector<std::uint8_t> column_;            // (H, W) distance along the column
    std::vector<std::uint16_t> row_;
    std::vector<std::uint16_t> clearance2_; // (H, W) squared, in cells
    std::vector<std::uint8_t> level_;       // padded; 0 blocked, else 1 + 254 O
    std::vector<Run> runs_;
    std::vector<int> first_run_; // of each row
    // Padded like level_, of the rows from first_row_ to last_row_: those that the search came near to.
    std::vector<std::uint8_t> moves_;     // bit k: move k out of the cell is free
    std::vector<std::uint16_t> cost_;     // of entering the cell straight on, units
    std::vector<std::uint32_t> estimate_; // of the way to the target, units
    // Of a cell, or with headings of each of the eight ways into it:
    std::vector<std::uint32_t> g_;       // least units to it so far
    std::vector<std::uint8_t> came_by_;  // the move into the cell; with headings the one before
    std::vector<std::uint32_t> least_g_; // with headings: the least of the eight, and its way
    std::vector<std::uint8_t> least_heading_;
    int first_row_ = 0, last_row_ = 0;
    BucketQueue queue_;
    Cell target_; // estimates are of the way to it
    std::size_t target_cell_ = 0;
    bool leaves_ = false; // it lies outside, and the route ends at the border
    std::size_t end_ = 0; // cell in which the last route ends
    int end_heading_ = 0;
    int offset_[8];
    std::vector<Cell> cells_;
    std::vector<double> to_go_;
};

} // namespace adrl
