// Runs the controller as a controller manager does, against a robot.  Arguments: a step of the goal (m), and
// "topic" or "chained".  Prints what a test asserts.
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>

#include "controller_interface/chainable_controller_interface.hpp"
#include "diagnostic_msgs/msg/diagnostic_status.hpp"
#include "geometry_msgs/msg/pose_stamped.hpp"
#include "geometry_msgs/msg/twist_stamped.hpp"
#include "robot.hpp"

using controller_interface::CallbackReturn;
using controller_interface::return_type;
using geometry_msgs::msg::PoseStamped;
using geometry_msgs::msg::TwistStamped;
using diagnostic_msgs::msg::DiagnosticStatus;

std::unique_ptr<controller_interface::ChainableControllerInterface> make_plugin();

static bool counts = false;
static int allocations = 0;

// Not inlined: g++ would take malloc and delete, or new and free, for a mismatch.
__attribute__((noinline)) void * operator new(std::size_t size)
{
  if (counts) { ++allocations; }
  if (void * memory = std::malloc(size)) { return memory; }
  throw std::bad_alloc();
}
__attribute__((noinline)) void operator delete(void * memory) noexcept { std::free(memory); }
__attribute__((noinline)) void operator delete(void * memory, std::size_t) noexcept
{
  std::free(memory);
}

template <typename Interface>
struct Interfaces
{
  explicit Interfaces(const std::vector<std::string> & names) : values(names.size())
  {
    for (std::size_t i = 0; i < names.size(); ++i) {
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"
      interfaces.push_back(Interface("robot", names[i], &values[i]));
#pragma GCC diagnostic pop
    }
  }
  template <typename Loaned>
  std::vector<Loaned> loaned()
  {
    std::vector<Loaned> all;
    for (Interface & interface : interfaces) { all.push_back(Loaned(interface)); }
    return all;
  }
  std::vector<double> values;
  std::vector<Interface> interfaces;
};

static Pose pose_of(const std::vector<double> & values)
{
  Pose pose;
  std::copy_n(values.begin(), 7, pose.begin());
  return pose;
}

int main(int, char ** arguments)
{
  const double cycle = 0.001, nothing = std::numeric_limits<double>::quiet_NaN();
  const bool is_chained = std::strcmp(arguments[4], "chained") == 0;
  rclcpp_lifecycle::LifecycleNode::overrides["measured_rate"] = 60.0;
  rclcpp_lifecycle::LifecycleNode::overrides["frame_id"] = std::string("the_base_of_the_robot");
  const auto controller = make_plugin();
  auto & node = *controller->get_node();
  const rclcpp_lifecycle::State state;
  if (controller->on_init() != CallbackReturn::SUCCESS) { return 1; }
  // Nobody tells how long a step is.
  if (controller->on_configure(state) != CallbackReturn::FAILURE) { return 2; }
  controller->update_rate = 1000;
  if (controller->on_configure(state) != CallbackReturn::SUCCESS) { return 3; }
  auto references = controller->export_reference_interfaces();
  Interfaces<hardware_interface::StateInterface> states(controller->state_interface_configuration().names);
  Interfaces<hardware_interface::CommandInterface> commands(
    controller->command_interface_configuration().names);
  controller->assign_interfaces(
    commands.loaned<hardware_interface::LoanedCommandInterface>(),
    states.loaned<hardware_interface::LoanedStateInterface>());
  controller->is_chained = is_chained;

  const PoseStamped start = node.publisher<PoseStamped>("~/commanded_pose").last;
  const auto & p = start.pose.position;
  const auto & q = start.pose.orientation;
  Robot robot({p.x, p.y, p.z, q.x, q.y, q.z, q.w});
  std::fill(states.values.begin(), states.values.end(), nothing);
  if (controller->on_activate(state) != CallbackReturn::FAILURE) { return 4; }
  std::copy(robot.tool.begin(), robot.tool.end(), states.values.begin());
  states.values[0] += 0.1;
  if (controller->on_activate(state) != CallbackReturn::FAILURE) { return 5; }
  states.values[0] -= 0.1;
  // A goal from before it is active is over.
  PoseStamped goal = start;
  goal.pose.position.x += 10;
  node.subscription<PoseStamped>("~/goal_pose").handle(goal);
  if (controller->on_activate(state) != CallbackReturn::SUCCESS) { return 6; }

  const auto & status = node.publisher<DiagnosticStatus>("~/status");
  const rclcpp::Duration period = rclcpp::Duration::from_seconds(cycle);
  const auto run = [&](int most, bool is_seen) {
    int done = 0;
    for (int k = 0; k < most; ++k) {
      if (k % 16 == 0) {
        const Pose seen = robot.measured();
        for (std::size_t i = 0; i < 7; ++i) { states.values[i] = is_seen ? seen[i] : nothing; }
      }
      counts = true;
      const return_type updated = controller->update(rclcpp::Time(k * 1000000), period);
      counts = false;
      if (updated != return_type::OK) { std::exit(7); }
      robot.follow(pose_of(commands.values), cycle);
      if (done == 0 && status.last.values[2].value == "true") { done = k + 1; }
    }
    return done;
  };

  const int first = run(12000, true);
  const Pose end = robot.tool;
  goal.pose.position = {end[0], end[1], end[2]};
  goal.pose.orientation = {end[3], end[4], end[5], end[6]};
  goal.pose.position.x += std::atof(arguments[1]);
  goal.pose.position.y += std::atof(arguments[2]);
  goal.pose.position.z += std::atof(arguments[3]);
  const Pose wanted{goal.pose.position.x,    goal.pose.position.y,    goal.pose.position.z,   end[3],
                    end[4], end[5], end[6]};
  if (is_chained) {
    for (std::size_t i = 0; i < 7; ++i) { references[i].value() = wanted[i]; }
  } else {
    goal.header.frame_id = "another";
    node.subscription<PoseStamped>("~/goal_pose").handle(goal);
    if (run(100, true) != 1) { return 8; }
    goal.header.frame_id = "the_base_of_the_robot";
    node.subscription<PoseStamped>("~/goal_pose").handle(goal);
  }
  run(12000, true);
  std::printf("done %d\nmissed %.9g\nstatus %s %s\nplans %s\n", first, apart(robot.tool, wanted),
              status.last.message.c_str(), status.last.values[2].value.c_str(),
              status.last.values[3].value.c_str());
  run(1000, false);
  std::printf("blind %s %d\nallocations %d\n", status.last.message.c_str(), status.last.level, allocations);

  std::fill(commands.values.begin(), commands.values.end(), 1.0);
  if (controller->on_deactivate(state) != CallbackReturn::SUCCESS) { return 9; }
  double twist = 0;
  for (std::size_t i = 7; i < 13; ++i) { twist += std::abs(commands.values[i]); }
  std::printf("twist %g\n", twist);
  return 0;
}
