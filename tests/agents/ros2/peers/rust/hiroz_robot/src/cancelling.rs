//! An action server whose goals are refused and cancelled by the rules of `action_msgs/srv/CancelGoal`.
//! hiroz's own loop knows neither, and waits for a result before it reads the next request.
use std::{
    collections::HashMap,
    sync::{Arc, Mutex},
};

use hiroz::{
    Result,
    action::{
        GoalId, GoalInfo, ZAction,
        messages::{CancelGoalServiceRequest, CancelGoalServiceResponse},
        server::{ExecutingGoal, ZActionServer},
    },
};
use zenoh::query::Query;

const UNKNOWN_GOAL: i8 = 2;
const TERMINATED: i8 = 3;

type Goals = Arc<Mutex<HashMap<[u8; 16], (GoalInfo, bool)>>>;

/// Carries out goals that `accepts` accepts by `run`, each in a task of its own.
pub fn serve<A, F>(
    server: ZActionServer<A>,
    accepts: fn(&A::Goal) -> bool,
    run: impl Fn(ExecutingGoal<A>) -> F + Send + Sync + 'static,
) where
    A: ZAction,
    F: Future<Output = Result<()>> + Send + 'static,
{
    let goals = Goals::default();
    let (cancelled, known) = (server.clone(), goals.clone());
    tokio::spawn(async move {
        while let Ok((request, query)) = cancelled.recv_cancel().await {
            cancel(&cancelled, &known, &request, query);
        }
    });
    tokio::spawn(async move {
        while let Ok(requested) = server.recv_goal().await {
            if !accepts(requested.goal()) {
                requested.reject().expect("a session");
                continue;
            }
            let id = bytes(&requested.info().goal_id);
            // No cancellation is read between the answer to the client and the start.
            let mut all = goals.lock().expect("no other task panicked");
            let goal = requested.accept().execute();
            all.insert(id, (goal.info().clone(), true));
            drop(all);
            let goals = goals.clone();
            let task = run(goal);
            tokio::spawn(async move {
                task.await.expect("a session");
                goals.lock().expect("no other task panicked").get_mut(&id).expect("it was put there").1 = false;
            });
        }
    });
}

fn cancel<A: ZAction>(server: &ZActionServer<A>, goals: &Goals, request: &CancelGoalServiceRequest, query: Query) {
    let goals = goals.lock().expect("no other task panicked");
    let asked = &request.goal_info;
    let (id, stamp) = (bytes(&asked.goal_id), (asked.stamp.sec, asked.stamp.nanosec));
    let (any, always) = (id == [0; 16], stamp == (0, 0));
    let meant = |info: &GoalInfo| {
        (any && always) || bytes(&info.goal_id) == id || (!always && (info.stamp.sec, info.stamp.nanosec) <= stamp)
    };
    let running = goals.values().filter(|(info, runs)| *runs && meant(info));
    let goals_canceling: Vec<_> = running.map(|(info, _)| info.clone()).collect();
    for info in &goals_canceling {
        server.request_cancel(info.goal_id);
    }
    let return_code = match goals.get(&id) {
        _ if any || !goals_canceling.is_empty() => 0,
        None => UNKNOWN_GOAL,
        Some(_) => TERMINATED,
    };
    let response = CancelGoalServiceResponse { return_code, goals_canceling };
    server.send_cancel_response_low(&query, &response).expect("a session");
}

fn bytes(id: &GoalId) -> [u8; 16] {
    *id.as_bytes()
}
