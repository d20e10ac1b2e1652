//! The actions of the robot: numbers, a trajectory, a gripper and a mobile base.
use std::{sync::Arc, time::Duration};

use hiroz::{
    Builder, Result,
    action::{
        ZAction,
        server::{ExecutingGoal, ZActionServer},
    },
    node::ZNode,
};

use hiroz_msgs::{builtin_interfaces::Duration as Span, geometry_msgs::PoseStamped};

use crate::{
    body::{Body, header, latched},
    cancelling,
    types::ros::{
        control_msgs::{
            FollowJointTrajectoryFeedback, FollowJointTrajectoryGoal, FollowJointTrajectoryResult,
            GripperCommandFeedback, GripperCommandResult,
            action::{FollowJointTrajectory, GripperCommand},
        },
        nav2_msgs::{NavigateToPoseFeedback, NavigateToPoseGoal, NavigateToPoseResult, action::NavigateToPose},
        test_msgs::{FibonacciFeedback, FibonacciResult, action::Fibonacci},
    },
};

const MOST_NUMBERS: i32 = 1000;
const KEPT: Duration = Duration::from_secs(900);
const STEPS: u32 = 10;

pub fn serve(node: &ZNode, body: Arc<Body>, pause: Duration) -> Result<()> {
    let server = offer::<Fibonacci>(node, "fibonacci")?;
    cancelling::serve(server, |goal| (0..=MOST_NUMBERS).contains(&goal.order), move |goal| count(goal, pause));

    let name = "joint_trajectory_controller/follow_joint_trajectory";
    let server = offer::<FollowJointTrajectory>(node, name)?;
    let arm = body.clone();
    cancelling::serve(server, accepts, move |goal| follow(goal, arm.clone(), pause));

    let (name, hand) = ("gripper_controller/gripper_cmd", body.clone());
    let server = offer::<GripperCommand>(node, name)?;
    cancelling::serve(server, |goal| goal.command.position >= 0.0, move |goal| grip(goal, hand.clone(), pause));

    let server = offer::<NavigateToPose>(node, "navigate_to_pose")?;
    cancelling::serve(
        server,
        |goal| !goal.pose.header.frame_id.is_empty(),
        move |goal| drive(goal, body.clone(), pause),
    );
    Ok(())
}

/// With a latched status, as in rcl.
fn offer<A: ZAction>(node: &ZNode, name: &str) -> Result<ZActionServer<A>> {
    node.create_action_server::<A>(name).with_result_timeout(KEPT).with_status_topic_qos(latched()).build()
}

/// As many numbers as the goal says, each of which is a feedback first.
async fn count(goal: ExecutingGoal<Fibonacci>, pause: Duration) -> Result<()> {
    let mut sequence = vec![0, 1];
    while sequence.len() < goal.goal.order as usize && !goal.is_cancel_requested() {
        tokio::time::sleep(pause).await;
        let next = (sequence[sequence.len() - 1] as i64 + sequence[sequence.len() - 2] as i64) % (1 << 31);
        sequence.push(next as i32);
        goal.publish_feedback(FibonacciFeedback { sequence: sequence.clone() })?;
    }
    let result = FibonacciResult { sequence };
    if goal.is_cancel_requested() { goal.canceled(result) } else { goal.succeed(result) }
}

fn accepts(goal: &FollowJointTrajectoryGoal) -> bool {
    let names = &goal.trajectory.joint_names;
    names.len() == 2
        && ["pan", "lift"].iter().all(|each| names.iter().any(|name| name == each))
        && !goal.trajectory.points.is_empty()
}

/// Point after point. A joint that should go beyond 1.9 rad violates the tolerance.
async fn follow(goal: ExecutingGoal<FollowJointTrajectory>, body: Arc<Body>, pause: Duration) -> Result<()> {
    let asked = goal.goal.trajectory.clone();
    for point in &asked.points {
        body.with(|state| state.goals = asked.joint_names.iter().cloned().zip(point.positions.clone()).collect());
        while let Some(error) = gap(&body) {
            if goal.is_cancel_requested() {
                body.with(|state| state.goals = state.positions.clone());
                return goal.canceled(FollowJointTrajectoryResult::default());
            }
            if point.positions.iter().any(|position| position.abs() > 1.9) {
                let error_string = "pan: path error 0.2 > 0.1".into();
                let error_code = FollowJointTrajectoryResult::PATH_TOLERANCE_VIOLATED;
                return goal.abort(FollowJointTrajectoryResult { error_code, error_string });
            }
            let mut feedback = FollowJointTrajectoryFeedback { header: header(""), ..Default::default() };
            feedback.joint_names = asked.joint_names.clone();
            feedback.error.positions = vec![error];
            goal.publish_feedback(feedback)?;
            tokio::time::sleep(pause.min(Duration::from_millis(50))).await;
        }
    }
    let error_string = "Goal successfully reached!".into();
    goal.succeed(FollowJointTrajectoryResult { error_code: FollowJointTrajectoryResult::SUCCESSFUL, error_string })
}

fn gap(body: &Body) -> Option<f64> {
    let state = body.with(|state| state.clone());
    let most = state.goals.iter().map(|(name, goal)| (goal - state.positions[name]).abs()).fold(0.0, f64::max);
    (most > 1e-6).then_some(most)
}

/// It meets an object 10 mm wide.
async fn grip(goal: ExecutingGoal<GripperCommand>, body: Arc<Body>, pause: Duration) -> Result<()> {
    let (wanted, effort) = (goal.goal.command.position, goal.goal.command.max_effort);
    let begin = body.with(|state| state.positions["finger"]);
    let mut position = begin;
    for step in 1..=STEPS {
        tokio::time::sleep(pause).await;
        position = f64::max(begin + (wanted - begin) * f64::from(step) / f64::from(STEPS), 0.01);
        body.with(|state| state.positions.insert("finger".into(), position));
        goal.publish_feedback(GripperCommandFeedback { position, ..Default::default() })?;
        if goal.is_cancel_requested() {
            return goal.canceled(GripperCommandResult { position, ..Default::default() });
        }
    }
    let stalled = position > wanted;
    goal.succeed(GripperCommandResult { position, effort, stalled, reached_goal: !stalled })
}

/// Straight to the pose in the map, in ten steps; no way leads further than 100 m.
async fn drive(goal: ExecutingGoal<NavigateToPose>, body: Arc<Body>, pause: Duration) -> Result<()> {
    let NavigateToPoseGoal { pose, .. } = goal.goal.clone();
    let (x, y, q) = (pose.pose.position.x - 1.0, pose.pose.position.y, &pose.pose.orientation);
    if x.hypot(y) > 100.0 {
        return goal.abort(no_path());
    }
    let start = body.with(|state| state.base);
    for step in 1..=STEPS {
        tokio::time::sleep(pause).await;
        if goal.is_cancel_requested() {
            return goal.canceled(NavigateToPoseResult::default());
        }
        let part = f64::from(step) / f64::from(STEPS);
        let at = (start.0 + (x - start.0) * part, start.1 + (y - start.1) * part, 2.0 * q.z.atan2(q.w) * part);
        body.with(|state| state.base = at);
        goal.publish_feedback(progress(at, (x - at.0).hypot(y - at.1), step))?;
    }
    goal.succeed(NavigateToPoseResult::default())
}

#[cfg(not(feature = "humble"))]
fn no_path() -> NavigateToPoseResult {
    NavigateToPoseResult { error_code: 208, error_msg: "no valid path found".into() }
}

/// Nav2 of Humble does not say why.
#[cfg(feature = "humble")]
fn no_path() -> NavigateToPoseResult {
    NavigateToPoseResult::default()
}

fn progress(at: (f64, f64, f64), distance: f64, step: u32) -> NavigateToPoseFeedback {
    let mut current_pose = PoseStamped { header: header("map"), ..Default::default() };
    (current_pose.pose.position.x, current_pose.pose.position.y) = (at.0 + 1.0, at.1);
    (current_pose.pose.orientation.z, current_pose.pose.orientation.w) = ((at.2 / 2.0).sin(), (at.2 / 2.0).cos());
    NavigateToPoseFeedback {
        current_pose,
        navigation_time: Span { sec: step as i32, nanosec: 0 },
        estimated_time_remaining: Span { sec: (STEPS - step) as i32, nanosec: 0 },
        number_of_recoveries: 0,
        distance_remaining: distance as f32,
    }
}
