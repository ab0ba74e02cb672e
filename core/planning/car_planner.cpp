#include "planning/car_planner.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>

namespace adrl {
namespace {

constexpr int kHeadings = 72;
constexpr double kHeading = 2.0 * std::numbers::pi / kHeadings;
constexpr double kMostTurn = std::numbers::pi / 8.0; // of an arc of the search
constexpr double kCell = 0.15;                       // metres, at least
constexpr double kCheck = 0.05;                      // metres between two poses that are looked at, at most
constexpr double kFine = 0.01;                       // and at least
constexpr double kCover = 0.01;                      // metres by which the balls may miss the footprint's rim
constexpr double kLeave = 1.0; // metres from the start within which it may be as near to obstacles as there
constexpr GearCosts kCosts{1.0, 0.5};
constexpr double kCurveReach = 12.0; // metres from the goal within which curves to it are tried
constexpr double kGoodEnough = 1.03; // a path that costs no more than so many times what any other must is taken
constexpr double kFar = 1e9;

int gear_of(const CarPiece &piece) { return piece.length == 0.0 ? kEitherGear : (piece.length < 0.0 ? -1 : 1); }

// Of the grid, to a cell of the search.
int cells_a_side(double resolution) { return std::max(1, static_cast<int>(std::lround(kCell / resolution))); }

template <class Item>
bool later(const Item &a, const Item &b) {
    return a.f > b.f || (a.f == b.f && a.node > b.node);
}

} // namespace

CarModel::CarModel(const Car &of, double resolution) : car(of), balls(footprint_balls(of.footprint, kCover)) {
    inner = car.footprint.radius;
    const std::vector<Vec2> &corners = car.footprint.corners;
    for (std::size_t k = 0; k < corners.size(); ++k) {
        const Vec2 e = corners[(k + 1) % corners.size()] - corners[k];
        inner = std::max(0.0, std::min(inner, cross(corners[k], e) / norm(e)));
    }
    // Far enough to leave a cell, and to turn by a heading.
    step = std::max(1.6 * cells_a_side(resolution) * resolution, 1.1 * kHeading * car.turning_radius);
    arc = std::min(step, kMostTurn * car.turning_radius);
    // Between two poses no place of the footprint comes nearer to anything than the margin spares, but for what the
    // clearance at a cell's centre may be too much.
    const double spare = car.margin - 0.72 * resolution;
    check = std::clamp(2.0 * spare / (1.0 + car.footprint.radius / car.turning_radius), kFine, kCheck);
}

CarPlanner::CarPlanner(int height, int width, double resolution, int most_poses)
    : height_(height), width_(width), resolution_(resolution), most_poses_(static_cast<std::size_t>(most_poses)) {
    const int each = cells_a_side(resolution);
    coarse_ = each * resolution;
    coarse_height_ = (height + each - 1) / each;
    coarse_width_ = (width + each - 1) / each;
    const auto cells = static_cast<std::size_t>(coarse_height_) * coarse_width_;
    distance_.resize(cells);
    passable_.resize(cells);
    cells_heap_.reserve(8 * cells);
    heap_.reserve(most_poses_);
    nodes_.reserve(most_poses_);
    table_.assign(std::bit_ceil(2 * most_poses_), {0, 0, -1});
    anchors_.reserve(most_poses_);
    poses_.reserve(kMostCorners);
}

float CarPlanner::clearance_at(double x, double y) const {
    const double column = std::floor((x - grid_.origin.x) / resolution_);
    const double row = std::floor((y - grid_.origin.y) / resolution_);
    if (!(column >= 0.0 && row >= 0.0 && column < width_ && row < height_)) return 0.0F;
    return grid_.clearance[static_cast<std::size_t>(row) * width_ + static_cast<std::size_t>(column)];
}

// Metres by which the footprint at a pose has more clearance than the margin; below 0 where it has less.
double CarPlanner::slack_at(const Pose &pose) const {
    double least = clearance_at(pose.x, pose.y) - model_->car.footprint.radius - model_->car.margin;
    if (least >= 0.0 || model_->balls.size() == 1) return least;
    const double c = std::cos(pose.theta), s = std::sin(pose.theta);
    least = kFar;
    for (const Ball &ball : model_->balls) {
        const double at = clearance_at(pose.x + c * ball.x - s * ball.y, pose.y + s * ball.x + c * ball.y);
        least = std::min(least, at - ball.radius - kCover - model_->car.margin);
        if (least < start_slack_) break;
    }
    return least;
}

bool CarPlanner::free_at(const Pose &pose) const {
    const double slack = slack_at(pose);
    if (slack >= 0.0) return true;
    return slack >= start_slack_ && std::hypot(pose.x - start_.x, pose.y - start_.y) < kLeave;
}

bool CarPlanner::drives_free(const Pose &from, const CarPiece &piece) const {
    const int pieces = std::max(1, static_cast<int>(std::ceil(std::abs(piece.length) / model_->check)));
    for (int k = 1; k <= pieces; ++k) {
        if (!free_at(drive_piece(from, piece, piece.length * k / pieces, model_->car.turning_radius))) return false;
    }
    return true;
}

bool CarPlanner::curve_free(const Pose &from, const CarCurve &curve) const {
    Pose at = from;
    for (int k = 0; k < curve.count; ++k) {
        if (!drives_free(at, curve.pieces[k])) return false;
        at = drive_piece(at, curve.pieces[k], curve.pieces[k].length, model_->car.turning_radius);
    }
    return true;
}

// The ways on the grid from the goal, for a disc that fits into the footprint: Dijkstra's, octile moves.
void CarPlanner::measure_distances() {
    const int each = cells_a_side(resolution_);
    for (int row = 0; row < coarse_height_; ++row) {
        for (int column = 0; column < coarse_width_; ++column) {
            float most = 0.0F;
            for (int y = row * each; y < std::min(height_, (row + 1) * each); ++y) {
                for (int x = column * each; x < std::min(width_, (column + 1) * each); ++x)
                    most = std::max(most, grid_.clearance[static_cast<std::size_t>(y) * width_ + x]);
            }
            passable_[static_cast<std::size_t>(row) * coarse_width_ + column] = most > model_->inner;
        }
    }
    std::fill(distance_.begin(), distance_.end(), static_cast<float>(kFar));
    cells_heap_.clear();
    const auto column = static_cast<int>(std::floor((goal_.x - grid_.origin.x) / coarse_));
    const auto row = static_cast<int>(std::floor((goal_.y - grid_.origin.y) / coarse_));
    if (row < 0 || column < 0 || row >= coarse_height_ || column >= coarse_width_) return;
    const auto first = static_cast<std::int32_t>(row * coarse_width_ + column);
    distance_[first] = 0.0F;
    cells_heap_.push_back({0.0, first});
    while (!cells_heap_.empty()) {
        std::pop_heap(cells_heap_.begin(), cells_heap_.end(), later<Open>);
        const Open at = cells_heap_.back();
        cells_heap_.pop_back();
        if (at.f > distance_[at.node]) continue;
        const int r = at.node / coarse_width_, c = at.node % coarse_width_;
        for (int dr = -1; dr <= 1; ++dr) {
            for (int dc = -1; dc <= 1; ++dc) {
                const int nr = r + dr, nc = c + dc;
                if ((dr == 0 && dc == 0) || nr < 0 || nc < 0 || nr >= coarse_height_ || nc >= coarse_width_) continue;
                const auto next = static_cast<std::int32_t>(nr * coarse_width_ + nc);
                if (!passable_[next]) continue;
                const auto d = static_cast<float>(at.f + coarse_ * (dr != 0 && dc != 0 ? std::numbers::sqrt2 : 1.0));
                if (d >= distance_[next]) continue;
                distance_[next] = d;
                cells_heap_.push_back({d, next});
                std::push_heap(cells_heap_.begin(), cells_heap_.end(), later<Open>);
            }
        }
    }
}

double CarPlanner::estimate(const Pose &pose) const {
    const auto column = static_cast<int>(std::floor((pose.x - grid_.origin.x) / coarse_));
    const auto row = static_cast<int>(std::floor((pose.y - grid_.origin.y) / coarse_));
    if (row < 0 || column < 0 || row >= coarse_height_ || column >= coarse_width_) return kFar;
    const double straight = std::hypot(pose.x - goal_.x, pose.y - goal_.y);
    return std::max<double>(straight, distance_[static_cast<std::size_t>(row) * coarse_width_ + column]);
}

std::uint32_t CarPlanner::key_of(const Pose &pose) const {
    const auto column = static_cast<std::uint32_t>((pose.x - grid_.origin.x) / coarse_);
    const auto row = static_cast<std::uint32_t>((pose.y - grid_.origin.y) / coarse_);
    const auto heading = static_cast<std::uint32_t>(std::lround(pose.theta / kHeading) + kHeadings) % kHeadings;
    return (row * coarse_width_ + column) * kHeadings + heading;
}

CarPlanner::Slot &CarPlanner::slot_of(std::uint32_t key) {
    const auto slots = static_cast<std::uint32_t>(table_.size());
    std::uint32_t at = (key * 2654435761U) & (slots - 1);
    while (table_[at].stamp == stamp_ && table_[at].key != key) at = (at + 1) & (slots - 1);
    return table_[at];
}

void CarPlanner::reach(const Pose &pose, double g, std::int32_t parent, const CarPiece &piece) {
    const std::uint32_t key = key_of(pose);
    Slot &slot = slot_of(key);
    if (slot.stamp == stamp_) {
        Node &before = nodes_[slot.node];
        if (before.closed || before.g <= g) return;
    }
    const double left = estimate(pose);
    if (left >= kFar || nodes_.size() == most_poses_) return;
    const auto index = static_cast<std::int32_t>(nodes_.size());
    if (slot.stamp == stamp_) nodes_[slot.node].closed = true; // what is queued of it is stale
    slot = {stamp_, key, index};
    nodes_.push_back({pose, g, piece, parent, false});
    heap_.push_back({g + left, index});
    std::push_heap(heap_.begin(), heap_.end(), later<Open>);
}

void CarPlanner::expand(std::int32_t index) {
    const Node from = nodes_[index];
    for (const int gear : {1, -1}) {
        if (gear < 0 && !model_->car.backward) break;
        const int before = gear_of(from.piece);
        const double cusp = before != kEitherGear && before != gear ? kCosts.cusp : 0.0;
        const double price = gear < 0 ? 1.0 + kCosts.backward : 1.0;
        for (const int turn : {0, 1, -1}) {
            const double length = turn == 0 ? model_->step : model_->arc;
            const CarPiece piece{gear * length, turn};
            if (!drives_free(from.pose, piece)) continue;
            const Pose to = drive_piece(from.pose, piece, piece.length, model_->car.turning_radius);
            reach(to, from.g + cusp + price * length, index, piece);
        }
    }
}

// The cheapest free one of the curves to the goal that end with a straight line to it, or point at it or away from it;
// of those below `most`.
bool CarPlanner::curve_to_goal(const Pose &from, int gear, double most, CarCurve &curve) const {
    double headings[6];
    int count = 0;
    const double c = std::cos(from.theta), s = std::sin(from.theta);
    for (const int side : {1, -1}) {
        const Vec2 centre{from.x - side * s * model_->car.turning_radius,
                          from.y + side * c * model_->car.turning_radius};
        const Vec2 away = goal_ - centre;
        const double d = norm(away);
        if (d < (1.0 - 1e-9) * model_->car.turning_radius) continue;
        // The line from the goal that touches the circle: forward with the turn, backward against it.
        const double bearing = std::atan2(away.y, away.x),
                     off = std::asin(std::min(1.0, model_->car.turning_radius / d));
        headings[count++] = wrap_angle(bearing + side * off);
        headings[count++] = wrap_angle(bearing - side * off + std::numbers::pi);
    }
    const double bearing = std::atan2(goal_.y - from.y, goal_.x - from.x);
    headings[count++] = bearing;
    headings[count++] = wrap_angle(bearing + std::numbers::pi);
    double least = most;
    bool found = false;
    for (int k = 0; k < count; ++k) {
        const CarCurve tried = reeds_shepp(from, {goal_.x, goal_.y, headings[k]}, model_->car.turning_radius, kCosts,
                                           gear, model_->car.backward);
        if (tried.count == 0) continue;
        const double cost = cost_of(tried, kCosts, gear);
        if (cost >= least || !curve_free(from, tried)) continue;
        least = cost;
        curve = tried;
        found = true;
    }
    return found;
}

bool CarPlanner::search() {
    ++stamp_;
    nodes_.clear();
    heap_.clear();
    expanded_ = 0;
    last_ = -1;
    double best = kFar;
    reach(start_, 0.0, -1, {});
    int until_curve = 0;
    while (!heap_.empty()) {
        std::pop_heap(heap_.begin(), heap_.end(), later<Open>);
        const Open at = heap_.back();
        heap_.pop_back();
        if (at.f * kGoodEnough >= best) break;
        if (nodes_[at.node].closed) continue;
        nodes_[at.node].closed = true;
        ++expanded_;
        const Node from = nodes_[at.node];
        const double left = at.f - from.g;
        if (--until_curve <= 0 && left < kCurveReach) {
            until_curve = 1 + static_cast<int>(4.0 * left);
            CarCurve curve;
            const int gear = gear_of(from.piece);
            if (curve_to_goal(from.pose, gear, best - from.g, curve)) {
                best = from.g + cost_of(curve, kCosts, gear);
                last_ = at.node;
                end_ = curve;
            }
        }
        expand(at.node);
    }
    return last_ >= 0;
}

void CarPlanner::trace() {
    anchors_.clear();
    for (std::int32_t at = last_; at >= 0; at = nodes_[at].parent)
        anchors_.push_back({nodes_[at].pose, nodes_[at].g, nodes_[at].piece});
    std::reverse(anchors_.begin(), anchors_.end());
}

void CarPlanner::add(const CarCurve &curve) {
    for (int k = 0; k < curve.count; ++k) {
        const CarPiece &piece = curve.pieces[k];
        const double length = std::abs(piece.length);
        const int chords = piece.turn == 0 ? 1 : std::max(1, static_cast<int>(std::ceil(length / kSpacing)));
        const Pose from = poses_.back();
        for (int i = 1; i <= chords; ++i)
            poses_.push_back(drive_piece(from, piece, piece.length * i / chords, model_->car.turning_radius));
    }
}

// From each anchor a curve to one as far ahead as can be that costs no more than the way found, or the piece to the
// next.
void CarPlanner::pull_taut() {
    poses_.clear();
    poses_.push_back(start_);
    const std::size_t last = anchors_.size() - 1;
    const double total = anchors_[last].cost + cost_of(end_, kCosts, gear_of(anchors_[last].piece));
    int gear = kEitherGear;
    for (std::size_t at = 0; at < last;) {
        const Anchor &from = anchors_[at];
        CarCurve curve;
        if (curve_to_goal(from.pose, gear, total - from.cost, curve)) {
            add(curve);
            return;
        }
        std::size_t next = at + 1;
        curve.pieces[0] = anchors_[next].piece;
        curve.count = 1;
        for (const double part : {1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.22, 0.16, 0.1, 0.05}) {
            const auto to = at + static_cast<std::size_t>(std::lround(part * static_cast<double>(last - at)));
            if (to <= at + 1) break;
            const CarCurve tried = reeds_shepp(from.pose, anchors_[to].pose, model_->car.turning_radius, kCosts, gear,
                                               model_->car.backward);
            if (tried.count == 0) continue;
            const bool turns_back = gear_of(tried.pieces[tried.count - 1]) != gear_of(anchors_[to].piece);
            const double cost = cost_of(tried, kCosts, gear) + (turns_back ? kCosts.cusp : 0.0);
            if (cost > anchors_[to].cost - from.cost || !curve_free(from.pose, tried)) continue;
            curve = tried;
            next = to;
            break;
        }
        add(curve);
        gear = gear_of(curve.pieces[curve.count - 1]);
        at = next;
    }
    CarCurve curve;
    add(curve_to_goal(anchors_[last].pose, gear, kFar, curve) ? curve : end_);
}

bool CarPlanner::plan(const CarModel &model, const ClearanceGrid &grid, const Pose &start, Vec2 goal) {
    model_ = &model;
    grid_ = grid;
    start_ = {start.x, start.y, wrap_angle(start.theta)};
    goal_ = goal;
    start_slack_ = -kFar;
    start_slack_ = std::min(0.0, slack_at(start_)) - 1e-6;
    measure_distances();
    if (!search()) return false;
    trace();
    pull_taut();
    return true;
}

} // namespace adrl
